// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/taxel_faults.hpp"

#include <algorithm>
#include <cmath>

#include "posfet_core/neighbour_estimate.hpp"
#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// The upper median of some values, whose order changes.
double upper_median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// The time for which something has lasted [s], after a block in which it did (`on`), or was known not to (`off`).
double lasted(double time, bool on, bool off, double duration) {
  if (on) {
    return time + duration;
  }
  return off ? 0.0 : time;
}

}  // namespace

TaxelFaultDetector::TaxelFaultDetector(const SkinResponse& skin, const TaxelFigures& figures, const bool* known_dead)
    : skin_(skin),
      figures_(figures),
      telegraph_(skin, figures.time_constant),
      history_(std::make_shared<CountHistory>(kMostScans + 2, static_cast<std::size_t>(skin.grid().taxels()))),
      noise_(figures.noise * figures.noise / (figures.newton_per_count * figures.newton_per_count)),
      measured_from_(figures.coarse ? kCoarseLoud : kQuietFactor * kQuietFactor),
      known_dead_(history_->taxels()),
      status_(history_->taxels(), TaxelStatus::kOk),
      faulty_(history_->taxels()) {
  const std::size_t count = history_->taxels();
  if (known_dead != nullptr) {
    known_dead_.set(known_dead);
    faulty_.set(known_dead);
  }
  any_faulty_ = faulty_.any();
  for (std::size_t taxel = 0; taxel < count; ++taxel) {
    status_[taxel] = known_dead_[taxel] ? TaxelStatus::kDead : TaxelStatus::kOk;
  }
  for (auto* values : {&usual_change_, &run_, &run_time_, &noisy_for_, &quiet_for_, &alone_for_, &silent_for_,
                       &responding_for_, &values_, &others_, &square_, &variance_}) {
    values->assign(count, 0.0);
  }
  for (auto* flags : {&touched_, &contradicted_, &noisy_, &calm_, &dead_, &changed_, &stuck_, &loud_, &flags_}) {
    *flags = TaxelFlags(count);
  }
  level_.assign(count, noise_);
  level_overall_ = level_;
  noise_variance_.assign(count, noise_ * (figures.newton_per_count * figures.newton_per_count));
  sizes_.reserve(history_->capacity());
}

void TaxelFaultDetector::find_informative(double deviation, bool* found) {
  const double most = deviation * deviation / (figures_.newton_per_count * figures_.newton_per_count);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    values_[taxel] = faulty_[taxel] ? 0.0 : level_overall_[taxel];
  }
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    found[taxel] = status_[taxel] == TaxelStatus::kNoisy && !telegraph_.found()[taxel] && !contradicted_[taxel];
    if (found[taxel]) {
      const double around = largest_neighbour(skin_.grid(), values_.data(), static_cast<Taxel>(taxel));
      const bool as_touch = level_overall_[taxel] <= maximum(most, kCommonTouch * kCommonTouch * around);
      found[taxel] = level_[taxel] <= most && as_touch;
    }
  }
}

bool TaxelFaultDetector::close_block(const TestedBlock& block, const Mask& touched) {
  add_to_period(block.duration, touched);
  test_levels(block.duration);
  test_runs(block);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    stuck_[taxel] = stuck_[taxel] || alone_for_[taxel] >= kConfirm;
  }
  if (is_period_over()) {
    test_noise(block.saturated);
    find_shown_errors(block);
    test_response(block.force, block.offset_known);
    test_alone(block.force, block.offset_known);
    end_period();
  }
  end_block();
  return update_status(block.duration);
}

void TaxelFaultDetector::measure_noise(double duration, const bool* saturated, const Mask& touched) {
  add_to_period(duration, touched);
  if (is_period_over()) {
    test_noise(saturated);
    end_period();
  }
  end_block();
}

void TaxelFaultDetector::add_to_period(double duration, const Mask& touched) {
  elapsed_ += duration;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    touched_[taxel] = touched_[taxel] || touched[taxel] != 0;
  }
  any_touched_ = touched_.any();
}

/// Whether the tests for noise and response are due.
bool TaxelFaultDetector::is_period_over() const {
  return elapsed_ >= kTestPeriod || history_->filled() == history_->capacity();
}

void TaxelFaultDetector::end_period() {
  history_->keep(2);  // so that no difference is lost
  elapsed_ = 0.0;
  std::fill(touched_.data(), touched_.data() + taxels(), false);
}

void TaxelFaultDetector::end_block() { last_ = history_->filled() > 0 ? history_->filled() - 1 : 0; }

/// Find the taxels with telegraph noise by the mean counts of the block.
void TaxelFaultDetector::test_levels(double duration) {
  const std::size_t first = last_ + 1;
  if (first >= history_->filled()) {
    return;
  }
  const std::size_t count = taxels();
  const auto scans = static_cast<double>(history_->filled() - first);
  std::vector<double>& mean = values_;
  std::vector<double>& variance = others_;
  std::fill(mean.begin(), mean.end(), 0.0);
  std::fill(variance.begin(), variance.end(), 0.0);
  const std::uint16_t* const begin = history_->counts().data() + first * count;
  const std::uint16_t* const end = history_->counts().data() + history_->filled() * count;
  for (const std::uint16_t* row = begin; row != end; row += count) {
    for (std::size_t taxel = 0; taxel < count; ++taxel) {
      mean[taxel] += row[taxel];
    }
  }
  for (double& each : mean) {
    each /= scans;
  }
  for (const std::uint16_t* row = begin; row != end; row += count) {
    for (std::size_t taxel = 0; taxel < count; ++taxel) {
      const double away = row[taxel] - mean[taxel];
      variance[taxel] += away * away;
    }
  }
  for (std::size_t taxel = 0; taxel < count; ++taxel) {
    variance[taxel] = std::max(variance[taxel] / scans, noise_) / scans;
    flags_[taxel] = !faulty_[taxel] || telegraph_.found()[taxel];
  }
  telegraph_.close_block(mean.data(), variance.data(), flags_.data(), duration, any_touched_);
}

/// Find the stuck taxels, and the taxels whose counts changed in this block.
void TaxelFaultDetector::test_runs(const TestedBlock& block) {
  const std::size_t count = taxels();
  std::fill(changed_.data(), changed_.data() + count, false);
  std::size_t steps = 0;
  for (std::size_t row = last_ + 1; row < history_->filled(); ++row, ++steps) {
    const std::uint16_t* const now = history_->counts().data() + row * count;
    const std::uint16_t* const before = now - count;
    for (std::size_t taxel = 0; taxel < count; ++taxel) {
      changed_[taxel] = changed_[taxel] || now[taxel] != before[taxel];
    }
  }
  for (std::size_t taxel = 0; taxel < count; ++taxel) {
    values_[taxel] = faulty_[taxel] ? 0.0 : std::abs(block.charge[taxel]);
  }
  for (std::size_t taxel = 0; taxel < count; ++taxel) {
    run_[taxel] = changed_[taxel] ? 0.0 : run_[taxel] + static_cast<double>(steps);
    run_time_[taxel] = changed_[taxel] ? 0.0 : run_time_[taxel] + block.duration;
    if (block.saturated[taxel]) {
      stuck_[taxel] = run_time_[taxel] > longest_saturation(taxel);
      continue;
    }
    // A constant charge would mean a force that grows at a constant rate, to within the noise.
    const double grown = std::abs(block.charge[taxel]) * (run_time_[taxel] / figures_.time_constant);
    stuck_[taxel] = run_[taxel] >= figures_.longest_run || grown > 0.5 * figures_.force_max;
  }
}

/// The longest time that a working taxel may stay at the end of its range [s]: until its charge has leaked; much less,
/// where no neighbour shows the force that would be required. The charges of the taxels that work are in `values_`.
double TaxelFaultDetector::longest_saturation(std::size_t taxel) const {
  const double around = largest_neighbour(skin_.grid(), values_.data(), static_cast<Taxel>(taxel));
  const bool alone = around < figures_.force_max / kAlone && std::isfinite(around) && figures_.spread_by_skin;
  return alone ? kConfirmDead : kLeakedRange * figures_.time_constant;
}

/// Find the noisy taxels, and the taxels that are quiet again.
void TaxelFaultDetector::test_noise(const bool* saturated) {
  const std::size_t count = taxels();
  others_ = level_;
  const double usual = std::max(noise_, upper_median(others_));
  const double* const now = update_levels(usual);
  for (std::size_t taxel = 0; taxel < count; ++taxel) {
    loud_[taxel] = level_[taxel] > kNoisyFactor * kNoisyFactor * usual && !touched_[taxel];
  }
  if (figures_.spread_by_skin && any_touched_) {
    compare_with_neighbours(usual, now);
  }
  const double newton2_per_count2 = figures_.newton_per_count * figures_.newton_per_count;
  for (std::size_t taxel = 0; taxel < count; ++taxel) {
    if (!saturated[taxel]) {  // those are not informative
      noisy_for_[taxel] = std::max(noisy_for_[taxel] + (loud_[taxel] ? elapsed_ : -elapsed_), 0.0);
    }
    noisy_[taxel] = noisy_for_[taxel] >= kConfirm;
    calm_[taxel] = level_[taxel] < kQuietFactor * kQuietFactor * usual;
    const bool measured = level_[taxel] > measured_from_ * noise_;
    noise_variance_[taxel] = (measured ? level_[taxel] : noise_) * newton2_per_count2;
  }
}

/// Update the noise levels by the second differences in memory; return the level of each taxel in memory alone.
const double* TaxelFaultDetector::update_levels(double usual) {
  const double differences = find_second_differences();
  if (differences == 0.0) {
    return level_overall_.data();
  }
  const double share = -std::expm1(-elapsed_ / kConfirm);
  const double most = (4.0 * kNoisyFactor) * (4.0 * kNoisyFactor) * usual;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    // White noise of variance v has second differences of variance 6*v.
    const double found = square_[taxel] / (6.0 * differences);
    square_[taxel] = found;
    level_overall_[taxel] += share * (found - level_overall_[taxel]);
    // Limited, so that a jump decays soon.
    level_[taxel] += (touched_[taxel] ? 0.0 : share) * (std::min(found, most) - level_[taxel]);
  }
  return square_.data();
}

/// Find the second differences of the counts in memory, where scans closely follow each other: their number, the sum of
/// the squares and the usual size of those of each taxel.
double TaxelFaultDetector::find_second_differences() {
  const std::size_t count = taxels();
  const TaxelFlags& close = history_->close();
  std::size_t found = 0;
  for (std::size_t row = 2; row < history_->filled(); ++row) {
    found += close[row] && close[row - 1] ? 1 : 0;
  }
  for (std::size_t taxel = 0; found > 0 && taxel < count; ++taxel) {
    sizes_.clear();
    double square = 0.0;
    for (std::size_t row = 2; row < history_->filled(); ++row) {
      if (close[row] && close[row - 1]) {
        const std::uint16_t* const now = history_->counts().data() + row * count + taxel;
        const int second =
            now[0] - 2 * now[-static_cast<std::ptrdiff_t>(count)] + now[-2 * static_cast<std::ptrdiff_t>(count)];
        square += static_cast<double>(second) * second;
        sizes_.push_back(std::abs(second));
      }
    }
    square_[taxel] = square;
    usual_change_[taxel] = upper_median(sizes_) * figures_.newton_per_count;
  }
  return static_cast<double>(found);
}

/// Add the taxels that are louder than any neighbour of a touch would let them be; `usual` is the usual noise level,
/// `now` that of each taxel in memory alone.
void TaxelFaultDetector::compare_with_neighbours(double usual, const double* now) {
  // Statistical uncertainty of a neighbour's noise level, from the second differences in memory.
  const double uncertainty = 4.0 * std::sqrt(3.9 * elapsed_ / (static_cast<double>(history_->filled()) * kConfirm));
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    values_[taxel] = faulty_[taxel] ? 0.0 : level_overall_[taxel];
  }
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double around =
        largest_neighbour(skin_.grid(), values_.data(), static_cast<Taxel>(taxel)) + (uncertainty - 1.0) * usual;
    const double least = kNeighbours * kNeighbours * maximum(around, uncertainty * usual);
    // A single jump is in memory, but not in the present.
    loud_[taxel] = loud_[taxel] || (level_overall_[taxel] > least && now[taxel] > least);
  }
}

/// Find the variance of each force with what negative forces show of the errors around it: no touch makes such forces,
/// so that what makes them, as warmth of the film, may have made other forces small.
void TaxelFaultDetector::find_shown_errors(const TestedBlock& block) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double force = block.force[taxel];
    const bool shows =
        block.offset_known[taxel] && !faulty_[taxel] && force < -kHeldCertainty * std::sqrt(block.variance[taxel]);
    values_[taxel] = shows ? -force : 0.0;
  }
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double around = largest_neighbour(skin_.grid(), values_.data(), static_cast<Taxel>(taxel));
    variance_[taxel] = block.variance[taxel] + square(maximum(values_[taxel], around));
  }
}

/// Find by the mean force of the last block [N] the dead taxels, and the dead ones that respond again.
void TaxelFaultDetector::test_response(const double* force, const bool* offset_known) {
  const std::size_t count = taxels();
  const double load = kDeadLoad * figures_.threshold;
  if (!std::any_of(force, force + count, [load](double each) { return each >= load; })) {
    std::fill(dead_.data(), dead_.data() + count, false);
    return;
  }
  for (std::size_t taxel = 0; taxel < count; ++taxel) {
    flags_[taxel] = faulty_[taxel] || !offset_known[taxel];
    values_[taxel] = maximum(kInformative * figures_.noise, kHeldCertainty * std::sqrt(variance_[taxel]));
  }
  for (std::size_t taxel = 0; taxel < count; ++taxel) {
    const double least =
        neighbour_lower_bound(skin_.grid(), force, flags_.data(), static_cast<Taxel>(taxel), values_.data());
    const bool loaded = least >= maximum(load, values_[taxel]) && offset_known[taxel];
    const bool silent = loaded && std::abs(force[taxel]) < kDeadShare * least;
    const bool responding = loaded && force[taxel] > 0.5 * least;
    silent_for_[taxel] = lasted(silent_for_[taxel], silent, loaded, elapsed_);
    responding_for_[taxel] = lasted(responding_for_[taxel], responding, silent, elapsed_);
    dead_[taxel] = silent_for_[taxel] >= kConfirmDead;
  }
}

/// Update how long taxels have held a force that their neighbours contradict, by the mean of the last block [N]. Such
/// taxels failed while they were pressed, or their signal is not that of a force.
void TaxelFaultDetector::test_alone(const double* force, const bool* offset_known) {
  TaxelFlags& sound = flags_;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    sound[taxel] = offset_known[taxel] && !faulty_[taxel];
    values_[taxel] = 0.0;
  }
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const bool forced = force[taxel] >= figures_.release_threshold;
    const auto contradicts = [&](const double* variances, double certainty) {
      return skin_.test(static_cast<Taxel>(taxel), force, variances, sound.data(), certainty, false).contradicted;
    };
    const bool alone = forced && touched_[taxel] && sound[taxel] && contradicts(variance_.data(), kHeldCertainty);
    alone_for_[taxel] = alone ? alone_for_[taxel] + elapsed_ : 0.0;
    // Of the mean of a block, the noise of a noisy taxel is a small part.
    contradicted_[taxel] = forced && status_[taxel] == TaxelStatus::kNoisy && contradicts(values_.data(), 0.0);
  }
}

/// Update the status of all taxels by what the tests have found; return whether the set of faulty ones changed.
bool TaxelFaultDetector::update_status(double duration) {
  bool any = any_faulty_;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    any = any || stuck_[taxel] || noisy_[taxel] || telegraph_.found()[taxel] || dead_[taxel];
  }
  if (!any) {
    return false;
  }
  bool different = false;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    quiet_for_[taxel] = is_sound(taxel) && !any_touched_ ? quiet_for_[taxel] + duration : 0.0;
    status_[taxel] = next_status(taxel);
    const bool faulty = status_[taxel] != TaxelStatus::kOk;
    different = different || faulty != faulty_[taxel];
    faulty_[taxel] = faulty;
  }
  any_faulty_ = faulty_.any();
  return different;
}

/// Whether a taxel shows nothing more of its fault.
bool TaxelFaultDetector::is_sound(std::size_t taxel) const {
  switch (status_[taxel]) {
    case TaxelStatus::kDead:
      return calm_[taxel] && responding_for_[taxel] >= kConfirmDead;
    case TaxelStatus::kStuck:
      return calm_[taxel] && changed_[taxel];
    default:
      return calm_[taxel] && !telegraph_.found()[taxel];
  }
}

TaxelStatus TaxelFaultDetector::next_status(std::size_t taxel) const {
  if (known_dead_[taxel]) {
    return TaxelStatus::kDead;
  }
  if (stuck_[taxel]) {
    return TaxelStatus::kStuck;
  }
  const bool telegraph = telegraph_.found()[taxel];
  const bool noisy = noisy_[taxel] || telegraph;
  TaxelStatus status = status_[taxel];
  if (quiet_for_[taxel] >= kRecovery || (noisy && status == TaxelStatus::kDead)) {
    status = TaxelStatus::kOk;
  }
  if ((noisy && status == TaxelStatus::kOk) || (telegraph && status == TaxelStatus::kStuck && changed_[taxel])) {
    return TaxelStatus::kNoisy;
  }
  return dead_[taxel] && status == TaxelStatus::kOk ? TaxelStatus::kDead : status;
}

}  // namespace posfet
