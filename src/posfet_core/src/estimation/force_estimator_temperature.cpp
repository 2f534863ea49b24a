// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// What the sensors say of the temperature, and whether a change that all taxels share is one, or a press.

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "force_estimator_constants.hpp"
#include "posfet_core/estimation/force_estimator.hpp"
#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// Greatest change of the logarithm of the sensors' lag by one reading [1]: the lag is nearly linear in it, then.
constexpr double kLargestLagStep = 0.5;

/// Time in which readings show at what rate the film has warmed since before the start [s]: it is constant.
constexpr double kEarly = 2.0;

}  // namespace

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
  return belief()->shared[kFilm] - before[kFilm] - before[kRate] * blocks_.times().back();
}

/// Whether readings of the sensors may tell a press from a film that cools: their lag is calibrated, as it looks like a
/// press where the rate changes; no contact has just been released, whose warmth is in all zeros; and all offsets are
/// known.
bool ForceEstimator::may_tell() const {
  return priors_.slow_rate > 0.0 && rested_ >= Witnesses::kSpacing && state().knows_offsets();
}

/// Let the witnesses follow a block. Where a reading is not what the sensors alone let expect, the temperature does
/// something of its own, and they know nothing of a press.
void ForceEstimator::follow_witnesses(const Block& block) {
  if (!may_tell()) {
    witnesses_.clear();
    return;
  }
  witnesses_.pass(block);
  Witness* witness = witnesses_.behind();
  if (witness == nullptr) {
    return;
  }
  static_cast<Passage&>(passed_) = witnesses_.next(*witness);
  predict(witness->filter, passed_);
  const Contradiction found = measure_temperature(witness->filter, passed_, false);
  witness->evidence += passed_.unlikely - (found.square + found.spread);
  ++witness->next;
  if (found.square > square(kSurprising)) {
    witnesses_.clear();
  }
}

/// Believe the witness with the most evidence, if that is enough, and if zeros have hidden a press since then.
/// Something wide presses all taxels, then. Not while the hypothesis of a warmer film is open, which has a witness of
/// its own. Otherwise a new witness is called when it is time.
bool ForceEstimator::take_witness(Block& block) {
  const Witness* best = nullptr;
  for (std::size_t index = 0; index < witnesses_.size(); ++index) {
    const Witness& each = witnesses_[index];
    const double hidden = (belief()->shared[kFilm] - each.filter.belief()->shared[kFilm]) * mean_per_kelvin();
    const double least = best == nullptr ? ZeroRefutation::kEvidence : best->evidence;
    best = hidden > 0.0 && each.evidence > least && !uniform_.open() ? &each : best;
  }
  if (best == nullptr) {
    if (may_tell()) {
      witnesses_.call(*belief());
    }
    return false;
  }
  *belief() = best->before;
  witnesses_.replay(*best, passed_, [this](const Block& passed) {
    predict(filter_, passed);
    measure_temperature(filter_, passed, false);
  });
  ++processed_again_;
  refutation_.refute();
  touch_all(block);
  forget_blocks();
  return true;
}

/// Admit a change of the film's temperature where it explains residuals of a stored block that are not expected.
void ForceEstimator::explain_by_temperature(std::size_t index) {
  const Block& block = blocks_[index];
  const bool listed = block.listed.any();
  if (!listed && block.touched.any()) {
    return;  // a touch has begun, and what follows is its own
  }
  bool noticed = false;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    noticed = noticed || (!listed && odd_[taxel] && zeros_[taxel]);
  }
  // While a contact grows, the rest of a wide object rises like a warmer film.
  const TaxelFlags& telling = listed ? zeros_ : judged_;
  const double kelvin = uniform_.temperature(residual_.data(), telling.data(), deviation_.data(), own_deviation_.data(),
                                             block.duration, noticed);
  if (kelvin == 0.0) {
    return;
  }
  if (kelvin * mean_per_kelvin() > 0.0 && !listed && state().knows_offsets()) {
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
  // The change in the newest block is added when that is judged.
  const Block& newest = blocks_.newest();
  expected_rate_ = unheated_.belief()->shared[kRate];
  expected_film_ = unheated_.belief()->shared[kFilm] - (expected_rate_ + newest.warming) * newest.duration;
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

}  // namespace posfet
