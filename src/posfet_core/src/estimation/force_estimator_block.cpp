// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// What a block shows: its mean forces, the reading of the temperature, the touch, the noise, and what a force that is
// steady tells of the errors.

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>
#include <vector>

#include "force_estimator_constants.hpp"
#include "posfet_core/estimation/force_estimator.hpp"
#include "posfet_core/numbers.hpp"
#include "posfet_core/product.hpp"

namespace posfet {

namespace {

/// Least force that stands in for an unknown one beside a contact [contact threshold].
constexpr double kLeastFelt = 0.1;

/// Least time constant of the leakage that is believed, relative to that of the calibration at its temperature [1].
constexpr double kLeastLeak = 0.5;

/// Force of which only is known that it has all of the thermal contact [N].
constexpr double kSaturating = std::numeric_limits<double>::infinity();

/// Time in which a film may recover from a force that no response knows by as much as it creeps [s], assumed.
constexpr double kRecovering = 1.0;

/// What warmth hides, over the force that causes most of it, from which on such forces come and go [1].
constexpr double kHides = 2.0;

/// Deviations of a block's mean by which a force must change to have moved [1].
constexpr double kPlay = 4.0;

/// Product of the change of a value and of the greater one of both.
double changed_square(double now, double before) {
  return std::abs(now - before) * std::max(std::abs(now), std::abs(before));
}

}  // namespace

/// Measure the block that is due.
void ForceEstimator::measure(Block& block) {
  const ForceIntegration::Block& scans = integration_->block();
  block.duration = scans.elapsed;
  block.leak = scans.leak;
  block.span = 0.5 * (last_duration_ + scans.elapsed);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    block.mean[taxel] = state().raw_sum[taxel] / scans.scans;
    block.noise[taxel] = noise_variance_[taxel] / scans.scans;
    // What leaks in a block is its mean charge.
    const double leaked = state().raw[taxel] - signal(taxel);
    block.charge[taxel] = (leaked - leaked_[taxel]) * (array_.time_constant[taxel] / (scans.elapsed * scans.leak));
    leaked_[taxel] = leaked;
    // Noise is no motion: without this play its path would count, which is long after a minute. A
    // NaN does not stay.
    const double play = kPlay * std::sqrt(block.noise[taxel]);
    steady_[taxel] = std::min(mean_[taxel] + play, std::max(mean_[taxel] - play, steady_[taxel]));
  }
  readings_.take(*integration_, block);
  find_tails(block);
  block.touch_before = touch_;
  unseen_for_ += block.span;
  measure_touch(block);
  std::transform(block.mean.begin(), block.mean.end(), touch_.loops().begin(), block.mean.begin(), std::minus<>());
  measure_process_noise(block);
  block.before = *belief();
  last_duration_ = scans.elapsed;
}

/// Find what the touch lets the taxels beside it feel.
void ForceEstimator::find_tails(Block& block) {
  if (!block.touched.any()) {
    std::fill(block.neighbour.begin(), block.neighbour.end(), 0.0);
    std::fill(block.tail.begin(), block.tail.end(), 0.0);
    return;
  }
  const double least = kLeastFelt * array_.threshold;
  std::vector<double>& felt = values_;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    felt[taxel] = ignored()[taxel] ? kUnknown : std::abs(steady_[taxel]);
  }
  surroundings_.complete(felt, least);
  surroundings_.greatest_neighbour(felt, block.neighbour);
  surroundings_.geometric_decline(felt, least, block.tail);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    block.tail[taxel] = block.touched[taxel] ? 0.0 : block.tail[taxel];
  }
}

/// What a belief says of the errors that the responses to a touch depend on, at the leakage of a block.
TouchResponse::Known ForceEstimator::known_errors(const Belief& belief, const Block& block) {
  return {std::max(1.0 + belief.shared[kLeak], kLeastLeak) / block.leak - 1.0, belief.shared[kWarmth]};
}

/// Advance the responses to the touch.
void ForceEstimator::measure_touch(Block& block) {
  std::vector<double>& force = values_;
  std::vector<double>& least = deviation_;
  std::vector<double>& most = own_deviation_;
  surroundings_.dilate(block.listed, chosen_);
  const double spread = 2.0 * tail_spread(*belief());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    // Without the force that is the warmth's own, which would keep itself up.
    const double by_warmth = array_.newton_per_kelvin[taxel] * belief()->shared[kWarmth] * touch_.warm()[taxel];
    const double tail = chosen_[taxel] ? block.tail[taxel] : 0.0;
    force[taxel] = chosen_[taxel] && counts(taxel) ? std::max(steady_[taxel], 0.0) : 0.0;
    least[taxel] = std::max(force[taxel] + std::min(by_warmth, 0.0), priors_.tail * tail);
    most[taxel] = std::max(force[taxel], spread * tail);
  }
  if (priors_.warmth_certain > 0.0) {
    add_held_forces(force, least, block.duration);
    follow_thermal_contact(block.duration);
    for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
      if (chosen_[taxel] && thermal_contact_.warmed(taxel)) {
        least[taxel] = most[taxel] = kSaturating;
      }
    }
  }
  touch_.advance(force, least, most, block.duration, known_errors(*belief(), block));
  touch_.matrix(block.response);
  block.warming = touch_.warming();
}

/// What warmth hides of a force, over the force that causes most of that warmth [1].
double ForceEstimator::hidden_share() const {
  return -mean_per_kelvin() * belief()->shared[kWarmth] / std::max(priors_.warmth_force, array_.threshold);
}

/// Raise what forces are at least, where warmth might be all of them, to what they were when what certainly presses
/// beside them came to rest.
void ForceEstimator::add_held_forces(const std::vector<double>& force, std::vector<double>& least, double duration) {
  TaxelFlags& certain = odd_;
  std::vector<double>& pressing = residual_;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    pressing[taxel] = ignored()[taxel] ? 0.0 : force[taxel];
    certain[taxel] = !ignored()[taxel] && least[taxel] > array_.threshold;
  }
  held_forces_.update(pressing, certain, duration);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (chosen_[taxel] && !certain[taxel]) {
      least[taxel] = std::max(least[taxel], held_forces_.held(taxel));
    }
  }
}

/// Follow what the taxels read but for their warmth, where that may be all of a force.
void ForceEstimator::follow_thermal_contact(double duration) {
  const std::vector<double>& shared = belief()->shared;
  if (hidden_share() <= 1.0) {
    thermal_contact_.reset();
    return;
  }
  std::vector<double>& reading = residual_;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double warmed = shared[kWarmth] * touch_.warm()[taxel] + shared[kWeakWarmth] * touch_.range()[taxel];
    reading[taxel] = ignored()[taxel] ? 0.0 : mean_[taxel] + array_.newton_per_kelvin[taxel] * warmed;
  }
  thermal_contact_.update(reading, duration);
}

/// Take the variance of what has leaked unseen while the signal of a taxel was clipped [N2]: that adds to what is wrong
/// already.
double ForceEstimator::clipped_noise(std::size_t taxel) {
  const double clipped = std::exchange(state().clipped[taxel], 0.0);
  const double wrong = std::max(belief()->own_of(taxel)[own_at(kForceError, kForceError)], 0.0);
  return square(std::sqrt(wrong) + clipped) - wrong;
}

/// Find the process noise of a block: what the filter does not expect of the taxels, and of their temperature.
void ForceEstimator::measure_process_noise(Block& block) {
  const bool touches = block.touched.any();
  std::vector<double>& pressing = values_;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    pressing[taxel] = block.touched[taxel] ? std::max(steady_[taxel], 0.0) : 0.0;
    deviation_[taxel] = touches ? std::sqrt(whole_variance(taxel)) : 0.0;
  }
  const double total = sum(pressing);
  const double before = sum(touch_force_);
  block.moved_share = moved_share_.update(pressing, deviation_);
  block.tail_moved = 0.0;
  std::fill(block.own_noise.begin(), block.own_noise.end(), 0.0);
  add_signal_noise(block);
  add_warmth_noise(block);
  if (touches || touch_.responding() || touched_.any()) {
    add_touch_noise(block, pressing);
  }
  touch_force_ = pressing;
  tail_ = block.tail;
  add_unknown_warmth(block);
  // As far from the temperature of the calibration as never before.
  const double farther = std::max(farthest_, std::abs(integration_->block().warmer));
  block.leak_noise = square(array_.leak_temperature.deviation) * (square(farther) - square(farthest_));
  farthest_ = farther;
  const Belief& b = *belief();
  const double earlier = (blocks_.size() == 0 ? b : blocks_[0].before).shared[kRate];
  const double heating = heating_.update(before, total, b.shared[kRate], std::sqrt(b.variance(kRate)), earlier);
  block.rate_noise = (square(priors_.touch_rate) + square(heating)) * changed_square(total, before) +
                     square(priors_.warming_share) * changed_square(block.warming, block.touch_before.warming());
}

/// By how much a film may still creep back from what left unseen, relative to the force that left [1].
double ForceEstimator::unseen_creep() const {
  double creep = 0.0;
  for (std::size_t each = 0; each < kCreeps; ++each) {
    creep += std::hypot(priors_.creep_mean[each], priors_.creep[each]);
  }
  return creep * recovery_left();
}

/// Add what noise and steps of the signals, and of their offsets, do to the forces.
void ForceEstimator::add_signal_noise(Block& block) {
  const double recovery = square(unseen_creep()) * (block.span / kRecovering);
  const double walk = square(priors_.offset_walk) * block.span;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    double* own = block.own_noise.data() + taxel * kOwnStates * kOwnStates;
    const double leaked = integration_->block().square * square(block.leak / array_.time_constant[taxel]);
    const double stepped = rest_noise_.jumps().variance(taxel, block.span);
    stepped_[taxel] = block.touched[taxel] ? stepped_[taxel] + stepped : 0.0;
    own[own_at(kForceError, kOffset)] = own[own_at(kOffset, kForceError)] = own[own_at(kOffset, kOffset)] = walk;
    own[own_at(kForceError, kForceError)] = walk + recovery * square(left_force_[taxel]) +
                                            noise_variance_[taxel] * leaked + state().jumped[taxel] + stepped +
                                            clipped_noise(taxel);
  }
}

/// Add by how much the warmth of a taxel may begin to differ from the common one; find what share of it cools. A force
/// that rises beside a contact cannot be told from warmth: each is as likely.
void ForceEstimator::add_warmth_noise(Block& block) {
  const double cooled = -std::expm1(-block.span / priors_.warmth_time);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    double* own = block.own_noise.data() + taxel * kOwnStates * kOwnStates;
    const double warmed = warmth_variance(taxel);
    const double warmth = touch_.warm()[taxel] + touch_.range()[taxel];
    const double left = warmth_[taxel] > 0.0 ? warmth / warmth_[taxel] : 0.0;
    block.cooled[taxel] = std::min(std::max(1.0 - left, 0.0), cooled);
    const double differs = std::max(warmed, warmed_[taxel]) - square(1.0 - block.cooled[taxel]) * warmed_[taxel];
    add_own_warmth(own, differs);
    own[own_at(kSmallForce, kSmallForce)] = std::max(warmed - warmed_[taxel], 0.0);
    warmed_[taxel] = warmed;
    warmth_[taxel] = warmth;
  }
}

/// Add what a film does as the force changes, and how the small forces beside a contact change with those in it.
void ForceEstimator::add_touch_noise(Block& block, const std::vector<double>& pressing) {
  const double spread = square(tail_spread(*belief()));
  double whole = 0.0;
  double moved = 0.0;
  surroundings_.dilate(block.touched, chosen_);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    double* own = block.own_noise.data() + taxel * kOwnStates * kOwnStates;
    const double tail = block.tail[taxel];
    own[own_at(kForceError, kForceError)] +=
        square(priors_.motion) * changed_square(pressing[taxel], touch_force_[taxel]);
    own[own_at(kSmallForce, kSmallForce)] += spread * changed_square(tail, tail_[taxel]);
    if (chosen_[taxel]) {  // where all the force has moved, the cover tells nothing of what is beside it
      own[own_at(kSmallForce, kSmallForce)] += block.moved_share * square(tail);
    }
    whole += std::max(tail, tail_[taxel]);
    moved += std::abs(tail - tail_[taxel]);
  }
  block.tail_moved = whole > 0.0 ? moved / whole : 0.0;
}

/// Add the warmth that no response knows, of taxels that count as untouched from now on: on a hot film they do so once
/// it is no more than a contact threshold.
void ForceEstimator::add_unknown_warmth(Block& block) const {
  if (!may_be_hot()) {
    return;
  }
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (touched_[taxel] && !block.touched[taxel]) {
      add_own_warmth(block.own_noise.data() + taxel * kOwnStates * kOwnStates, square(array_.threshold));
    }
  }
}

/// Observe the noise of the stored blocks; that of the temperature not where a touch may have begun, or has just ended.
void ForceEstimator::observe_noise(const Block& block) {
  rested_ = block.listed.any() ? 0.0 : rested_ + block_time();
  const bool at_rest = blocks_.full() && has_rested(kQuiet);
  const bool comparable = usable() >= kFewestForUniform && uniform_.observable();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    chosen_[taxel] = !ignored()[taxel];
  }
  if (blocks_.full()) {
    rest_noise_.observe_steps(blocks_, *belief(), chosen_, at_rest && comparable);
  }
  if (!at_rest || !comparable || block.touched.any()) {
    rest_noise_.pause();
  } else {
    const double known = rest_noise_.walk().intensity();
    rest_noise_.observe_walk(blocks_, *belief(), chosen_);
    admit_walk(known);
  }
}

/// Admit what a random walk of the temperature may have done that was weaker as far as was known [K2/s]. As far as it
/// can look like a drift of the offsets, it counted as one: the film warmed by less then, since the start, and zeros
/// were the same.
void ForceEstimator::admit_walk(double known) {
  const double walk = rest_noise_.walk().intensity();
  if (walk > known) {
    std::array<double, kSharedStates> drifting{};
    drifting[kDrift] = 1.0;
    drifting[kRate] = -1.0 / mean_per_kelvin();
    drifting[kChip] = drifting[kFilm] = drifting[kSensor] = age() * drifting[kRate];
    const double observed = std::min(age(), TemperatureWalk::kMemory * TemperatureWalk::kLeastTime);
    filter_.widen(drifting.data(), square(mean_per_kelvin() / age()) * (walk - known) * observed);
  }
  dynamics_.set_film_walk(walk);
}

/// Update the shared states by a force that has been steady in all stored blocks.
void ForceEstimator::observe_steady_force() {
  if (!steady_force_.is_due(blocks_.full() && blocks_.newest().listed.any())) {
    return;
  }
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    chosen_[taxel] = !ignored()[taxel] && !lower_bound_.mask()[taxel];
  }
  const Taxels held = held_taxels(blocks_, chosen_);
  if (held.empty()) {
    return;
  }
  const Belief& b = *belief();
  const SteadyWindow window = window_of(blocks_, b, held);
  double coldest = std::numeric_limits<double>::infinity();
  double warmest = -coldest;
  for (std::size_t index = 0; index < blocks_.size(); ++index) {
    coldest = std::min(coldest, blocks_[index].before.shared[kFilm]);
    warmest = std::max(warmest, blocks_[index].before.shared[kFilm]);
  }
  double response = 0.0;
  double noise = 0.0;
  for (const Taxel each : held) {
    response += array_.newton_per_kelvin[static_cast<std::size_t>(each)];
    noise += blocks_.newest().noise[static_cast<std::size_t>(each)];
  }
  const double changed = std::sqrt(b.variance(kRate)) * (window.time.back() - window.time.front());
  const auto found = steady_force_.observe(window, std::abs(response) * (warmest - coldest + changed), noise);
  if (!found) {
    return;
  }
  const double expected = filter_.shared_variance(found->sensitivity.data()) + found->variance;
  if (square(found->innovation) < square(kSurprising) * expected) {
    filter_.measure_shared(found->innovation, found->sensitivity.data(), found->variance);
  }
}

/// Find a taxel whose force drifts alone: its signal has stepped. Not where warmth may be all of a force, which it
/// keeps up as it comes and goes.
void ForceEstimator::observe_lone_drift(const Block& block) {
  if (hidden_share() > kHides) {
    lone_drift_.restart();
    return;
  }
  double noise = 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    chosen_[taxel] = !ignored()[taxel] && !lower_bound_.mask()[taxel] && offset_known()[taxel];
    noise = chosen_[taxel] ? std::max(noise, block.noise[taxel]) : noise;
  }
  const auto found =
      lone_drift_.observe(mean_.data(), chosen_.data(), block.listed.data(), block.touched.data(), noise, block.span);
  if (found) {
    admit_step(*found);
  }
}

/// Correct the errors of a taxel whose signal has stepped, at some time since it was last known to be still.
void ForceEstimator::admit_step(const LoneDrift::Drift& found) {
  const double step = found.rate * present_time_constant(found.taxel);
  double* error = belief()->error_of(found.taxel);
  error[kOffset] += step;
  error[kForceError] += step + 0.5 * (found.earliest + found.latest) * found.rate;
  belief()->own_of(found.taxel)[own_at(kForceError, kForceError)] +=
      square((found.earliest - found.latest) * found.rate) / 12.0;
  rest_noise_.admit_step(found.taxel, step);
  forget_blocks();  // to process them again would undo it
}

}  // namespace posfet
