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

namespace posfet {

namespace {

/// Factor on the prior deviation of the residual charge after that prior was rejected [1].
constexpr double kRejected = 3.0;

/// Time constants after which the film is no longer warm [1].
constexpr double kCooled = 4.0;

/// Variance of a common tail of which nothing is known [1], assumed: as after all the force has moved from taxel to
/// taxel. What is beside a contact rises on all of its side at once as it comes.
constexpr double kUnknownTail = 0.15;

}  // namespace

/// Process the stored blocks again without the taxels that a touch, it turned out, had begun on. Those that do not show
/// it themselves are left out of the last blocks only: their zeros before that tell their offsets. Where sensors have
/// refuted the zeros of all, the rate may have been wrong before these blocks, too.
void ForceEstimator::process_again(const TaxelFlags& touched) {
  ++processed_again_;
  const bool wide = refuted_ != 0.0 || was_misled();
  *belief() = blocks_[0].before;
  if (refuted_ != 0.0) {
    witnesses_.clear();  // of another past
    const double since = std::max(LastBlocks::kLag * kBlock, blocks_.duration());
    const std::vector<double>& direction = dynamics_.maneuver(belief()->shared, since);
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

/// Propagate a belief over a block; finds the taxels beside a contact.
void ForceEstimator::predict(ForceErrorFilter& filter, const Block& block) {
  Belief& b = *filter.belief();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    small_[taxel] = !block.touched[taxel] && block.neighbour[taxel] > 0.0;
    chosen_[taxel] = !small_[taxel];
  }
  b.forget_small_forces(chosen_.data());
  own_noise_ = block.own_noise;
  const double spread = tail_spread(b);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const std::size_t place = taxel * kOwnStates * kOwnStates + own_at(kSmallForce, kSmallForce);
    if (small_[taxel] && b.own[place] == 0.0) {  // beside the contact since now
      own_noise_[place] = square(spread * block.tail[taxel] + priors_.tail_least * block.neighbour[taxel]);
    }
  }
  SharedTransition& shared = dynamics_.transition(b.shared, block.span, block.warming);
  // As the forces beside the contact change, the tail does by as much as it is.
  const double forgotten = block.moved_share + 0.5 * square(spread) / kUnknownTail * block.tail_moved;
  const double kept = std::exp(-forgotten);
  shared.matrix[kTail * kSharedStates + kTail] = kept;
  shared.after[kTail] = priors_.tail + kept * (b.shared[kTail] - priors_.tail);
  shared.noise[kTail * kSharedStates + kTail] = (1.0 - square(kept)) * kUnknownTail;
  shared.noise[kRate * kSharedStates + kRate] += block.rate_noise;
  shared.noise[kLeak * kSharedStates + kLeak] += block.leak_noise;
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
    zeros_[taxel] = usable && !(block.touched[taxel] && offset_known()[taxel]) && !recovers_unseen(taxel);
  }
  expect_small_forces(block);
  find_residuals();
  admit_warmer_object();
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
  measure_alone(block);
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

/// Whether the film of a taxel recovers from a force that no response knows: what it shows tells nothing of the others.
bool ForceEstimator::recovers_unseen(std::size_t taxel) const {
  return left_force_[taxel] > 0.0 && unseen_for_ < kCooled * priors_.warmth_time;
}

/// Share of that recovery that is left [1].
double ForceEstimator::recovery_left() const { return std::exp(-unseen_for_ / priors_.creep_times.back()); }

/// Update the taxels whose forces say nothing of the others: those that recover unseen, and the faulty ones. A noisy
/// taxel still counts in a contact, and so must be zero before it.
void ForceEstimator::measure_alone(const Block& block) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const bool unseen = !ignored()[taxel] && recovers_unseen(taxel);
    zeros_[taxel] = (unseen || is_zero_faulty(block, taxel)) && !block.touched[taxel] && !odd_[taxel];
  }
  if (!zeros_.any()) {
    return;
  }
  filter_.residuals(measured_.data(), response_.data(), values_.data());
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
    noise_[taxel] += warmth_variance(taxel) + kTailNoise + square(priors_.tail_change * block.neighbour[taxel]);
  }
}

void ForceEstimator::find_residuals() {
  filter_.innovation(measured_.data(), response_.data(), noise_.data(), residual_.data(), sensitivity_.data(),
                     deviation_.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    own_deviation_[taxel] = std::sqrt(belief()->own_variance(taxel) + noise_[taxel]);
  }
}

/// Where zeros of what was touched show a film that is warmer than all that is believed of the common warmth, as no
/// object pulls, that belief was wrong since the touch began: widen it, and the errors of the forces by it.
void ForceEstimator::admit_warmer_object() {
  std::array<double, kSharedStates> sensitivity{};  // of the sum of the zeros by their weight
  double sum = 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double* own = sensitivity_.data() + taxel * kSharedStates;
    const bool warm = std::abs(own[kWarmth]) > HotFilm::kWarmed * std::abs(array_.newton_per_kelvin[taxel]);
    if (zeros_[taxel] && warm) {
      const double weight = own[kWarmth] / square(own_deviation_[taxel]);
      sum += weight * residual_[taxel];
      for (std::size_t state = 0; state < kSharedStates; ++state) {
        sensitivity[state] += weight * own[state];
      }
    }
  }
  const double information = sensitivity[kWarmth];
  if (information == 0.0) {  // nothing is warm
    return;
  }
  const double change = sum / information;
  const double expected = (filter_.shared_variance(sensitivity.data()) + information) / square(information);
  if (change * mean_per_kelvin() < 0.0 && square(change) > square(kGate) * (expected + square(warmth_difference()))) {
    filter_.widen(direction_of(kWarmth).data(), square(change));
    find_residuals();
  }
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

}  // namespace posfet
