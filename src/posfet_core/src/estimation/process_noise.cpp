// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/process_noise.hpp"

#include <algorithm>
#include <cmath>

#include "posfet_core/estimation/propagation.hpp"
#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// Product of the change of a value and of the greater one of both.
double changed_square(double now, double before) {
  return std::abs(now - before) * std::max(std::abs(now), std::abs(before));
}

/// Covariance of the process noise of a taxel, [own, own].
double* noise_of(Block& block, std::size_t taxel) { return block.own_noise.data() + taxel * kOwnStates * kOwnStates; }

}  // namespace

ProcessNoise::ProcessNoise(const EstimatedArray& array, const ContactSurroundings& surroundings)
    : array_(array), surroundings_(surroundings), moved_share_(array.taxels()) {
  for (auto* values : {&stepped_, &force_, &before_, &deviation_, &tail_, &warmth_, &warmed_}) {
    values->assign(array_.taxels(), 0.0);
  }
}

void ProcessNoise::forget() {
  farthest_ = 0.0;
  for (auto* values : {&stepped_, &force_, &tail_, &warmth_, &warmed_}) {
    std::fill(values->begin(), values->end(), 0.0);
  }
}

void ProcessNoise::measure(Block& block, const Shown& shown) {
  const bool touches = block.touched.any();
  force_.swap(before_);
  for (std::size_t taxel = 0; taxel < force_.size(); ++taxel) {
    force_[taxel] = block.touched[taxel] ? std::max(shown.force[taxel], 0.0) : 0.0;
    deviation_[taxel] = touches ? std::sqrt(shown.covariance.of_motion(taxel)) : 0.0;
  }
  block.moved_share = moved_share_.update(force_, deviation_);
  block.tail_moved = 0.0;
  std::fill(block.own_noise.begin(), block.own_noise.end(), 0.0);
  add_signal_noise(block, shown);
  add_warmth_noise(block, shown);
  if (touches || shown.touch.responding() || shown.was_touched.any()) {
    add_touch_noise(block, shown.belief);
  }
  tail_ = block.tail;
  if (shown.may_be_hot) {
    add_unknown_warmth(block, shown.was_touched);
  }
  find_shared_noise(block, shown);
}

/// Add what noise and steps of the signals, and of their offsets, do to the forces.
void ProcessNoise::add_signal_noise(Block& block, const Shown& shown) {
  const double walk = square(array_.priors.offset_walk) * block.span;
  for (std::size_t taxel = 0; taxel < force_.size(); ++taxel) {
    double* own = noise_of(block, taxel);
    const double leaked = shown.integration.block().square * square(block.leak / array_.time_constant[taxel]);
    const double stepped = shown.jumps.variance(taxel, block.span);
    stepped_[taxel] = block.touched[taxel] ? stepped_[taxel] + stepped : 0.0;
    own[own_at(kForceError, kOffset)] = own[own_at(kOffset, kForceError)] = own[own_at(kOffset, kOffset)] = walk;
    own[own_at(kForceError, kForceError)] = walk + shown.unseen.variance(taxel, block.span) +
                                            shown.reading[taxel] * leaked + shown.integration.state().jumped[taxel] +
                                            stepped + shown.clipped[taxel];
  }
}

/// Add by how much the warmth of a taxel may begin to differ from the common one; find what share of it cools. A force
/// that rises beside a contact cannot be told from warmth: each is as likely.
void ProcessNoise::add_warmth_noise(Block& block, const Shown& shown) {
  const double cooled = -std::expm1(-block.span / array_.priors.warmth_time);
  for (std::size_t taxel = 0; taxel < force_.size(); ++taxel) {
    double* own = noise_of(block, taxel);
    const double warmed = shown.touch.warmth_variance(taxel, shown.belief.shared[kWarmth]);
    const double warmth = shown.touch.warm()[taxel] + shown.touch.range()[taxel];
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
void ProcessNoise::add_touch_noise(Block& block, const Belief& belief) {
  const double spread = square(tail_spread(array_.priors, belief));
  double whole = 0.0;
  double moved = 0.0;
  TaxelFlags near(force_.size());
  surroundings_.dilate(block.touched, near);
  for (std::size_t taxel = 0; taxel < force_.size(); ++taxel) {
    double* own = noise_of(block, taxel);
    const double tail = block.tail[taxel];
    own[own_at(kForceError, kForceError)] +=
        square(array_.priors.motion) * changed_square(force_[taxel], before_[taxel]);
    own[own_at(kSmallForce, kSmallForce)] += spread * changed_square(tail, tail_[taxel]);
    if (near[taxel]) {  // where all the force has moved, the cover tells nothing of what is beside it
      own[own_at(kSmallForce, kSmallForce)] += block.moved_share * square(tail);
    }
    whole += std::max(tail, tail_[taxel]);
    moved += std::abs(tail - tail_[taxel]);
  }
  block.tail_moved = whole > 0.0 ? moved / whole : 0.0;
}

/// Add the warmth that no response knows, of taxels that count as untouched from now on: on a hot film they do so once
/// it is no more than a contact threshold.
void ProcessNoise::add_unknown_warmth(Block& block, const TaxelFlags& was_touched) const {
  for (std::size_t taxel = 0; taxel < force_.size(); ++taxel) {
    if (was_touched[taxel] && !block.touched[taxel]) {
      add_own_warmth(noise_of(block, taxel), square(array_.threshold));
    }
  }
}

/// Find the noise of the leak rates, as the array is as far from the temperature of the calibration as never before,
/// and of the rate of the temperature, as the touch changes.
void ProcessNoise::find_shared_noise(Block& block, const Shown& shown) {
  const double farther = std::max(farthest_, std::abs(shown.integration.block().warmer));
  block.leak_noise = square(array_.leak_temperature.deviation) * (square(farther) - square(farthest_));
  farthest_ = farther;
  const Belief& b = shown.belief;
  const double total = sum(force_);
  const double before = sum(before_);
  const double heating =
      heating_.update(before, total, b.shared[kRate], std::sqrt(b.variance(kRate)), shown.earlier_rate);
  block.rate_noise = (square(array_.priors.touch_rate) + square(heating)) * changed_square(total, before) +
                     square(array_.priors.warming_share) * changed_square(block.warming, block.touch_before.warming());
}

}  // namespace posfet
