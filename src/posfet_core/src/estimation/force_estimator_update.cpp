// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// A step of the filter: what is known of the forces of a block, and what follows for the errors.

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "force_estimator_constants.hpp"
#include "posfet_core/estimation/force_estimator.hpp"
#include "posfet_core/numbers.hpp"
#include "posfet_core/product.hpp"

namespace posfet {

namespace {

/// Factor on the prior deviation of the residual charge after that prior was rejected [1].
constexpr double kRejected = 3.0;

/// Greatest change of the logarithm of the sensors' lag by one reading [1]: the lag is nearly linear in it, then.
constexpr double kLargestLagStep = 0.5;

/// Blocks over which the error of a taxel beside a contact stays the same [1]: one second.
constexpr double kCorrelated = 50.0;

/// Time in which readings show at what rate the film has warmed since before the start [s]: it is constant.
constexpr double kEarly = 2.0;

/// Deviation of the force of a taxel beside a contact, in addition to shares of its neighbours' [N].
constexpr double kLeastTail = 1e-4;

/// Variance of a common tail of which nothing is known [1], assumed: as after all the force has moved from taxel to
/// taxel. What is beside a contact rises on all of its side at once as it comes.
constexpr double kUnknownTail = 0.15;

}  // namespace

/// Whether the rate of the temperature has changed since the oldest stored block by more than its dynamics let expect,
/// as the forces rose: zeros of what a wide object presses do that, each by too little to be noticed.
bool ForceEstimator::was_misled() {
  if (blocks_.size() == 0) {
    return false;
  }
  const Belief& before = blocks_[0].before;
  const double change = belief()->shared[kRate] - before.shared[kRate];
  const double noise = dynamics_.transition(before.shared, blocks_.newest().span).noise[kRate * kSharedStates + kRate];
  const double variance = before.variance(kRate) + static_cast<double>(blocks_.size()) * noise;
  return change * mean_per_kelvin() > 0.0 && square(change) > square(kSurprising) * variance;
}

/// By how much zeros of a wide object may have changed the film's temperature unnoticed since the oldest stored block
/// [K]. Not soon after a contact, whose release moves the rate, too.
double ForceEstimator::unnoticed_change() {
  if (!has_rested() || !was_misled()) {
    return 0.0;
  }
  const std::vector<double>& before = blocks_[0].before.shared;
  double passed = 0.0;
  for (std::size_t index = 0; index < blocks_.size(); ++index) {
    passed += blocks_[index].span;
  }
  return belief()->shared[kFilm] - before[kFilm] - before[kRate] * passed;
}

/// Process the stored blocks again without the taxels that a touch, it turned out, had begun on. Those that do not show
/// it themselves are left out of the last blocks only: their zeros before that tell their offsets. Where sensors have
/// refuted the zeros of all, the rate may have been wrong before these blocks, too.
void ForceEstimator::process_again(const TaxelFlags& touched) {
  ++processed_again_;
  const bool wide = was_misled();
  *belief() = blocks_[0].before;
  if (refuted_ != 0.0) {
    witnesses_.clear();  // of another past
    const std::vector<double>& direction = dynamics_.maneuver(belief()->shared, LastBlocks::kLag * kBlock);
    filter_.admit(direction.data(), square(refuted_ / direction[kFilm]));
  }
  const std::size_t count = blocks_.size();  // the newest one may restart taxels, which forgets them
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    chosen_[taxel] = touched[taxel] && (blocks_.newest().listed[taxel] || unexplained_.rising()[taxel]);
  }
  for (std::size_t index = 0; index < count; ++index) {
    const TaxelFlags& begun = index + LastBlocks::kSuspected < count ? chosen_ : touched;
    TaxelFlags& stored = blocks_[index].touched;
    for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
      stored[taxel] = stored[taxel] || begun[taxel] || (wide && offset_known()[taxel]);
    }
  }
  for (std::size_t index = 0; index < count; ++index) {
    blocks_[index].before = *belief();
    step(index);
  }
}

/// Propagate the belief over a stored block, and update it by the temperature and by the forces that are known.
void ForceEstimator::step(std::size_t index) {
  Block& block = blocks_[index];
  predict(filter_, block);
  bool zeros = false;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    double& variance = belief()->own_of(taxel)[own_at(kOffset, kOffset)];
    variance = std::max(variance, rest_noise_.jumps().least_offset_variance(taxel));
    zeros = zeros || (!block.touched[taxel] && !ignored()[taxel] && unexplained_.below()[taxel] == 0.0);
  }
  const Contradiction found = measure_temperature(filter_, block, zeros);
  block.unlikely = std::min(found.square, square(kSurprising)) + found.spread;
  const bool hidden = zeros && found.kelvin * mean_per_kelvin() < 0.0 && !uniform_.open() && has_rested();
  refuted_ = 0.0;
  if (hidden && found.deviations > ZeroRefutation::kContradicted && was_misled()) {
    refuted_ = found.kelvin;
    refutation_.refute();
  }
  measure_zeros(index);
}

/// Update a belief by a new reading of the temperature sensors, if there is one. Returns how it differs from what the
/// belief expects, after all that explains it.
///
/// An unexpected one shows that the rate changed, at least as if the sensors had no lag. While zero forces determine
/// the temperature of the film, it may have warmed since before the start; soon after that, and not where something
/// touches, which warms it, too. If neither explains it, it shows only that the sensors differ from their model, and is
/// weighted down.
ForceEstimator::Contradiction ForceEstimator::measure_temperature(ForceErrorFilter& filter, const Block& block,
                                                                  bool zeros) {
  if (std::isnan(block.reading)) {
    return {0.0, 0.0, 0.0, 0.0};
  }
  double variance = block.reading_variance;
  const auto is_surprising = [](const TemperatureInnovation& found) {
    return square(found.innovation) > square(kSurprising) * found.variance;
  };
  TemperatureInnovation found = filter.temperature_innovation(block.reading, variance, block.leaked_time);
  const double squared = square(found.innovation) / found.variance;
  const double spread = std::log(found.variance);
  if (is_surprising(found) && !zeros) {
    const double rate = std::min(std::abs(found.innovation) / block.interval, priors_.fastest);
    filter.admit(dynamics_.maneuver(filter.belief()->shared, block.interval).data(), square(rate));
    found = filter.temperature_innovation(block.reading, variance, block.leaked_time);
  }
  const bool early = block.leaked_time < kEarly && !block.touched.any();
  if (is_surprising(found) && zeros && uniform_.observable() && early) {
    std::array<double, kSharedStates> earlier{};
    earlier[kEarlier] = 1.0;
    earlier[kZero] = -0.5 * block.leaked_time;  // half of what was missed until now has counted as an error of the zero
    filter.admit(earlier.data(), square(std::min(2.0 * std::abs(found.innovation) / block.leaked_time, priors_.rate)));
    found = filter.temperature_innovation(block.reading, variance, block.leaked_time);
  }
  const Contradiction contradiction{found.innovation, std::abs(found.innovation) / std::sqrt(found.variance), squared,
                                    spread};
  if (is_surprising(found)) {
    variance += square(found.innovation / kSurprising);
    found = filter.temperature_innovation(block.reading, variance, block.leaked_time);
  }
  // The sensors' lag is exponential in its state: a step beyond the range of linearisation is made in parts.
  variance += std::max(std::abs(found.innovation * found.column[kLag]) / kLargestLagStep - found.variance, 0.0);
  filter.measure_temperature(block.reading, variance, block.leaked_time);
  return contradiction;
}

/// Propagate a belief over a block; finds the taxels beside a contact.
void ForceEstimator::predict(ForceErrorFilter& filter, const Block& block) {
  Belief& b = *filter.belief();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    small_[taxel] = !block.touched[taxel] && block.neighbour[taxel] > 0.0;
    chosen_[taxel] = !small_[taxel];
  }
  b.forget_small_forces(chosen_.data());
  own_noise_ = block.own_noise;
  const double spread = tail_spread();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const std::size_t place = taxel * kOwnStates * kOwnStates + own_at(kSmallForce, kSmallForce);
    if (small_[taxel] && b.own[place] == 0.0) {  // beside the contact since now
      own_noise_[place] = square(spread * block.tail[taxel] + priors_.tail_least * block.neighbour[taxel]);
    }
  }
  SharedTransition& shared = dynamics_.transition(b.shared, block.span);
  // As the forces beside the contact change, the tail does by as much as it is.
  const double forgotten = block.moved_share + 0.5 * square(spread) / kUnknownTail * block.tail_moved;
  const double kept = std::exp(-forgotten);
  shared.matrix[kTail * kSharedStates + kTail] = kept;
  shared.after[kTail] = priors_.tail + kept * (b.shared[kTail] - priors_.tail);
  shared.noise[kTail * kSharedStates + kTail] = (1.0 - square(kept)) * kUnknownTail;
  shared.noise[kRate * kSharedStates + kRate] += block.rate_noise;
  shared.noise[kLeak * kSharedStates + kLeak] += block.leak_noise;
  for (const std::size_t state : {kChip, kFilm, kSensor}) {
    shared.after[state] += shared.matrix[state * kSharedStates + kRate] * block.warming;
  }
  const double warming = shared.after[kFilm] - b.shared[kFilm];
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    values_[taxel] = array_.newton_per_kelvin[taxel] * warming;
    leaked_share_[taxel] = block.span * block.leak / array_.time_constant[taxel];
    driven_[taxel * kSharedStates + kDrift] = block.span * block.leak;
  }
  b.respond(values_.data());
  b.cool(block.cooled.data());
  filter.predict({shared.after.data(), shared.matrix.data(), shared.noise.data(), leaked_share_.data(), driven_.data(),
                  own_noise_.data()});
}

/// Update by the forces that are known to be zero or small.
void ForceEstimator::measure_zeros(std::size_t index) {
  const Block& block = blocks_[index];
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const bool usable = !ignored()[taxel];
    judged_[taxel] = usable && !(block.listed[taxel] && offset_known()[taxel]);
    zeros_[taxel] = usable && !(block.touched[taxel] && offset_known()[taxel]);
  }
  expect_small_forces(block);
  find_residuals();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    odd_[taxel] = std::abs(residual_[taxel]) > kGate * deviation_[taxel];
  }
  explain_by_temperature(index);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    // Of a release, some blocks look like a film that cools.
    odd_[taxel] = odd_[taxel] || (unexplained_.below()[taxel] > 0.0 && residual_[taxel] < -array_.threshold);
    zeros_[taxel] = zeros_[taxel] && !odd_[taxel];
  }
  if (zeros_.any()) {
    filter_.update(zeros_.data(), residual_.data(), sensitivity_.data(), noise_.data());
  }
  measure_faulty(block);
  if (index + 1 < blocks_.size()) {
    return;
  }
  find_slow_touches(block);
  judge(blocks_[index]);
}

/// Find taxels whose residuals have been positive for too long. What most taxels share, an update has explained: it is
/// no touch of a single one. Keeps of the residuals that are not expected those of taxels that count.
void ForceEstimator::find_slow_touches(const Block& block) {
  TaxelFlags& updated = zeros_;
  std::vector<double>& unmodelled = own_deviation_;
  // Responses differ, and leak as time constants do: by the rate before a touch that may have changed it.
  const double warming = priors_.pyroelectric * blocks_[0].before.shared[kRate] * block.duration;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    updated[taxel] = !block.touched[taxel] && !odd_[taxel];
    unmodelled[taxel] = square(array_.newton_per_kelvin[taxel] * warming);
  }
  filter_.post_fit(updated.data(), measured_.data(), response_.data(), noise_.data(), unmodelled.data(),
                   values_.data());
  TaxelFlags& watched = chosen_;
  TaxelFlags& zeros = zeros_;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    watched[taxel] = judged_[taxel] || is_zero_faulty(block, taxel);
    zeros[taxel] = watched[taxel] && !block.touched[taxel] && offset_known()[taxel];
  }
  unexplained_.add_persistent(zeros.data(), values_.data(), odd_.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    odd_[taxel] = odd_[taxel] && watched[taxel];
  }
}

/// Whether a taxel is faulty, and in no contact.
bool ForceEstimator::is_zero_faulty(const Block& block, std::size_t taxel) const {
  return ignored()[taxel] && offset_known()[taxel] && !block.listed[taxel];
}

/// Update the faulty taxels by their forces, which say nothing of the others: a noisy taxel still counts in a contact,
/// and so must be zero before it.
void ForceEstimator::measure_faulty(const Block& block) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    zeros_[taxel] = is_zero_faulty(block, taxel) && !block.touched[taxel] && !odd_[taxel];
  }
  if (!zeros_.any()) {
    return;
  }
  filter_.predicted(response_.data(), values_.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    values_[taxel] = measured_[taxel] - values_[taxel] - belief()->error_of(taxel)[kSmallForce];
  }
  filter_.update_alone(zeros_.data(), values_.data(), sensitivity_.data(), noise_.data());
}

/// Find what the forces of the taxels would be but for errors, with their responses to the shared states and the
/// variances of their noise.
void ForceEstimator::expect_small_forces(const Block& block) {
  const std::vector<double>& shared = belief()->shared;
  measured_ = block.mean;
  response_ = block.response;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    noise_[taxel] = block.noise[taxel];
    if (!small_[taxel]) {
      continue;
    }
    // What the shared states predict of the small force stays subtracted, as it is from the force.
    double* response = response_.data() + taxel * kSharedStates;
    for (std::size_t state = 0; state < kSharedStates; ++state) {
      if (is_of_touch(state)) {
        measured_[taxel] -= response[state] * shared[state];
        response[state] = 0.0;
      }
    }
    response[kTail] = block.tail[taxel];
    // As the contact moves, what is warm moves with it.
    noise_[taxel] += warmth_variance(taxel) + kCorrelated * square(kLeastTail) +
                     square(priors_.tail_change * block.neighbour[taxel]);
  }
}

void ForceEstimator::find_residuals() {
  filter_.innovation(measured_.data(), response_.data(), noise_.data(), residual_.data(), sensitivity_.data(),
                     deviation_.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    own_deviation_[taxel] = std::sqrt(belief()->own_variance(taxel) + noise_[taxel]);
  }
}

/// Admit a change of the film's temperature where it explains residuals of a stored block that are not expected.
void ForceEstimator::explain_by_temperature(std::size_t index) {
  const Block& block = blocks_[index];
  const bool listed = block.listed.any();
  if (!listed && block.touched.any()) {
    return;  // a touch has begun, and what follows is its own
  }
  bool noticed = false;
  bool rests_known = true;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    noticed = noticed || (!listed && odd_[taxel] && zeros_[taxel]);
    rests_known = rests_known && (offset_known()[taxel] || ignored()[taxel]);
  }
  // While a contact grows, the rest of a wide object rises like a warmer film.
  const TaxelFlags& telling = listed ? zeros_ : judged_;
  const double kelvin = uniform_.temperature(residual_.data(), telling.data(), deviation_.data(), own_deviation_.data(),
                                             block.duration, noticed);
  if (kelvin == 0.0) {
    return;
  }
  if (kelvin * mean_per_kelvin() > 0.0 && !listed && rests_known) {
    open_hypothesis();
  }
  const std::vector<double>& direction = dynamics_.maneuver(belief()->shared, block.duration);
  filter_.admit(direction.data(), square(kelvin / direction[kFilm]));
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    noise_[taxel] += square(priors_.pyroelectric * kelvin * array_.newton_per_kelvin[taxel]);
  }
  find_residuals();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double left = residual_[taxel] - kelvin * array_.newton_per_kelvin[taxel];
    odd_[taxel] = std::abs(left) > kGate * own_deviation_[taxel];
  }
}

/// Open the hypothesis that the film became warmer, and go on without it, too: as if a touch of all taxels had begun
/// with the stored blocks.
void ForceEstimator::open_hypothesis() {
  if (uniform_.open()) {
    return;
  }
  uniform_.begin();
  *unheated_.belief() = blocks_[0].before;
  unheated_touch_ = blocks_[0].touch_before;
  for (std::size_t index = 0; index < blocks_.size(); ++index) {
    follow_unheated(blocks_[index]);
  }
  expected_film_ = unheated_.belief()->shared[kFilm];
  expected_rate_ = unheated_.belief()->shared[kRate];
}

/// Follow the belief without the hypothesis, and what the touch leaves that there is without it.
void ForceEstimator::follow_unheated(const Block& block) {
  predict(unheated_, block);
  measure_temperature(unheated_, block, false);
  std::vector<double>& force = values_;
  unheated_touch_.matrix(unheated_response_);
  unheated_.predicted(unheated_response_.data(), force.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    force[taxel] = ignored()[taxel] ? 0.0 : std::max(block.mean[taxel] - force[taxel], 0.0);
  }
  unheated_touch_.advance(force, force, force, block.duration, known_errors(*unheated_.belief(), block));
}

/// Keep the belief as it is: what the other one would say no longer matters.
void ForceEstimator::drop_hypothesis() {
  uniform_.close();
  unconfirmed_ = 0.0;
}

/// Act on the residuals of the newest block that no state explains.
void ForceEstimator::judge(Block& block) {
  const UniformChange::Evidence evidence = evidence_of(block);
  std::size_t odd = 0;
  std::size_t judged = 0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    odd += odd_[taxel] && judged_[taxel] ? 1 : 0;
    judged += judged_[taxel] ? 1 : 0;
  }
  if (uniform_.is_refused(odd, judged, evidence, block.duration)) {
    uniform_.refuse();
    take_unheated(block);
  }
  unconfirmed_ = uniform_.open() ? evidence.claimed - evidence.shown : unnoticed_change();
  restart_or_correct(block);
}

/// What the sensors say of the hypothesis at the end of a block.
UniformChange::Evidence ForceEstimator::evidence_of(const Block& block) {
  UniformChange::Evidence evidence{kUnknown, kUnknown, kUnknown, negligible(), UniformChange::kConfirmation};
  // The hypothesis itself makes the sensors' lag seem longer.
  const Belief& shown = uniform_.open() ? *unheated_.belief() : *belief();
  if (uniform_.open()) {
    expected_film_ += (expected_rate_ + block.warming) * block.duration;
    evidence.claimed = belief()->shared[kFilm] - expected_film_;
    evidence.shown = shown.shared[kFilm] - expected_film_;
    evidence.deviation = std::sqrt(std::max(shown.variance(kFilm), 0.0));
  }
  evidence.wait += 2.0 * SharedDynamics::sensor_lag(shown.shared);
  evidence.wait += std::isnan(block.reading) ? UniformChange::kInterval : 0.0;
  return evidence;
}

/// Take the belief without the hypothesis, which was wrong.
void ForceEstimator::take_unheated(Block& block) {
  *belief() = *unheated_.belief();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    block.mean[taxel] -= unheated_touch_.loops()[taxel] - touch_.loops()[taxel];
  }
  touch_ = unheated_touch_;
  touch_.matrix(block.response);
  block.warming = touch_.warming();
  filter_.predicted(block.response.data(), residual_.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    residual_[taxel] = block.mean[taxel] - residual_[taxel];
    odd_[taxel] = judged_[taxel] && residual_[taxel] > 0.0;
  }
  forget_blocks();
}

/// Restart the taxels with an unexplained residual whose offset is unknown, and widen the errors of the others where it
/// is one of the baseline.
void ForceEstimator::restart_or_correct(Block& block) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    chosen_[taxel] = odd_[taxel] && !offset_known()[taxel];
    odd_[taxel] = odd_[taxel] && offset_known()[taxel];
    if (chosen_[taxel]) {
      const double widened = kRejected * left_deviation_[taxel];
      left_deviation_[taxel] = std::min(widened, kRunaway * array_.greatest_force);
      ++restarts_;
    }
    values_[taxel] = std::sqrt(block.noise[taxel]);
  }
  restart(chosen_);
  unexplained_.update(odd_.data(), residual_.data(), block.mean.data(), values_.data(), block.duration, chosen_.data());
  find_released();
  find_hot_film();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (chosen_[taxel] && !zeros_[taxel]) {
      const std::size_t variance = own_at(kForceError, kForceError);
      belief()->own_of(taxel)[variance] += square(residual_[taxel]);
      block.own_noise[taxel * kOwnStates * kOwnStates + variance] += square(residual_[taxel]);  // if processed again
    }
  }
  if (zeros_.any()) {
    reset_released(block);
  }
}

/// Find the taxels below zero, `zeros_`, where one of them has been so for long enough: what touched since before the
/// start was released.
void ForceEstimator::find_released() {
  bool released = false;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    zeros_[taxel] = odd_[taxel] && residual_[taxel] < -array_.threshold;
    released = released || (chosen_[taxel] && zeros_[taxel]);
  }
  if (!released) {
    zeros_.fill(false);
  }
}

/// Find whether the film is hotter than was known: it is where a touch may have warmed it and forces stay below zero.
/// Only what has touched since before the start and is released does that, too. Such taxels are left as they are, until
/// the film has cooled: none are in `zeros_` then.
void ForceEstimator::find_hot_film() {
  if (!zeros_.any()) {
    return;
  }
  hot_film_.find_warm(touch_.warm(), beside_, surroundings_);
  if (!hot_film_.explains(zeros_, residual_, array_.newton_per_kelvin)) {
    return;
  }
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    chosen_[taxel] = chosen_[taxel] && !zeros_[taxel];
    zeros_[taxel] = false;
  }
}

/// Set the forces of these taxels to zero. They and those beside them cool from then on.
void ForceEstimator::reset_released(const Block& block) {
  surroundings_.dilate(zeros_, chosen_);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (chosen_[taxel]) {
      absorbed_.touch(taxel);
      const double warmth = square(priors_.warmth_mean * array_.newton_per_kelvin[taxel]);
      double* own = belief()->own_of(taxel);
      own[own_at(kForceError, kForceError)] += warmth;
      own[own_at(kForceError, kOwnWarmth)] = own[own_at(kOwnWarmth, kForceError)] += warmth;
      own[own_at(kOwnWarmth, kOwnWarmth)] += warmth;
    }
    if (zeros_[taxel]) {
      belief()->reset_force_error(taxel, block.mean[taxel], block.response.data() + taxel * kSharedStates,
                                  block.noise[taxel]);
    }
  }
  zero_known_ = true;
  refutation_.clear();
  forget_blocks();  // to process them again would undo it
}

/// Set the forces of released contacts to zero.
void ForceEstimator::release(Block& block, const Vector<const Taxels*>& contacts) {
  std::vector<double>& variance = values_;
  std::vector<double>& course = residual_;
  filter_.predicted(block.response.data(), course.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    variance[taxel] = contacts.empty() ? own_[taxel] : whole_variance(taxel);
    const double* response = block.response.data() + taxel * kSharedStates;
    course[taxel] = block.mean[taxel] - course[taxel] + dot(response + kBend, belief()->shared.data() + kBend, kBends);
  }
  std::vector<double>& rise = deviation_;
  const bool known = blocks_.size() > ReleaseDetector::kStillBlocks;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    rise[taxel] =
        known ? block.mean[taxel] - blocks_[blocks_.size() - 1 - ReleaseDetector::kStillBlocks].mean[taxel] : 0.0;
  }
  const double noise = std::sqrt(*std::max_element(block.noise.begin(), block.noise.end()));
  if (!release_.update(contacts, mean_.data(), course.data(), rise.data(), touched_.data(), variance.data(), noise,
                       chosen_.data()) ||
      !drop_shown(variance)) {
    return;
  }
  find_absorbed();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (chosen_[taxel]) {
      touch_.reduce_warmth(taxel, mean_[taxel], belief()->shared[kWarmth]);
      belief()->own_of(taxel)[own_at(kForceError, kForceError)] += square(absorbed_.values()[taxel]);
    }
    noise_[taxel] = block.noise[taxel] + kCorrelated * square(kLeastTail);
  }
  touch_.matrix(block.response);
  filter_.innovation(block.mean.data(), block.response.data(), noise_.data(), residual_.data(), sensitivity_.data(),
                     deviation_.data());
  filter_.update(chosen_.data(), residual_.data(), sensitivity_.data(), noise_.data());
}

/// Drop, of the taxels in `chosen_` that look released, those beside a noisy taxel that still shows a force beyond its
/// variance; return whether any are left.
bool ForceEstimator::drop_shown(const std::vector<double>& variance) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double least = std::max(array_.threshold, kGate * std::sqrt(variance[taxel]));
    odd_[taxel] = ignored()[taxel] && informative_[taxel] && mean_[taxel] > least;
  }
  surroundings_.dilate(odd_, zeros_);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    chosen_[taxel] = chosen_[taxel] && !zeros_[taxel];
  }
  return chosen_.any();
}

/// End the touches since before an interruption: where forces stay below zero, they are zero.
void ForceEstimator::end_unknown_touch(const Block& block) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double limit = kGate * std::sqrt(2.0) * std::sqrt(block.noise[taxel]);
    chosen_[taxel] = std::abs(mean_[taxel] - last_mean_[taxel]) <= limit;
  }
  TaxelFlags ended(taxels());
  lower_bound_.update(mean_.data(), chosen_.data(), block.duration, ended.data());
  last_mean_ = mean_;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (ended[taxel]) {
      belief()->reset_force_error(taxel, block.mean[taxel], block.response.data() + taxel * kSharedStates,
                                  block.noise[taxel]);
    }
  }
  if (ended.any()) {
    forget_blocks();  // to process them again would undo it
  }
}

}  // namespace posfet
