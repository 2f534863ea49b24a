// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// What a block shows: its mean forces, the reading of the temperature, the touch, and the noise.

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

#include "force_estimator_constants.hpp"
#include "posfet_core/estimation/force_estimator.hpp"
#include "posfet_core/numbers.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

namespace {

/// What warmth hides, over the force that causes most of it, from which on such forces come and go [1].
constexpr double kHides = 2.0;

}  // namespace

/// Measure the block that is due.
void ForceEstimator::measure(Block& block) {
  const ForceIntegration::Block& scans = integration_->block();
  block.duration = scans.elapsed;
  block.leak = scans.leak;
  block.span = 0.5 * (last_duration_ + scans.elapsed);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    block.mean[taxel] = state_.raw_sum[taxel] / scans.scans;
    block.noise[taxel] = noise_variance_[taxel] / scans.scans;
    // What leaks in a block is its mean charge.
    const double leaked = state_.raw[taxel] - integration_->signal(taxel);
    block.charge[taxel] = (leaked - leaked_[taxel]) * (array_.time_constant[taxel] / (scans.elapsed * scans.leak));
    leaked_[taxel] = leaked;
  }
  readings_.take(*integration_, block);
  touched_forces_.follow(block, {*belief(), touch_, mean_, ignored(), informative_});
  block.touch_before = touch_;
  touch_.advance(touched_forces_.pressing(), touched_forces_.least(), touched_forces_.most(), block.duration,
                 known_errors(*belief(), block));
  touch_.matrix(block.response.data());
  block.warming = touch_.warming();
  std::transform(block.mean.begin(), block.mean.end(), touch_.loops().begin(), block.mean.begin(), std::minus<>());
  unseen_.pass(block.span);
  measure_process_noise(block);
  block.before = *belief();
  last_duration_ = scans.elapsed;
}

/// Find what the filter does not expect of the block; what has leaked unseen while signals were clipped adds to what is
/// wrong already.
void ForceEstimator::measure_process_noise(Block& block) {
  const Belief& b = *belief();
  Vector<double> clipped(taxels());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double wrong = std::max(b.own_of(taxel)[own_at(kForceError, kForceError)], 0.0);
    clipped[taxel] = square(std::sqrt(wrong) + std::exchange(state_.clipped[taxel], 0.0)) - wrong;
  }
  const Belief& earlier = blocks_.size() == 0 ? b : blocks_[0].before;
  process_noise_.measure(
      block, {b, earlier.shared[kRate], touch_, touched_forces_.steady(), covariance_, noise_variance_, clipped.data(),
              *integration_, rest_noise_.jumps(), unseen_, touched_, hot_film_.may_be_hot(b)});
}

/// Observe the noise of the stored blocks; that of the temperature not where a touch may have begun, or has just ended.
void ForceEstimator::observe_noise(const Block& block) {
  rested_ = block.listed.any() ? 0.0 : rested_ + block_time();
  const bool at_rest = blocks_.full() && has_rested(kQuiet);
  const bool comparable = state_.usable() >= kFewestForUniform && uniform_.observable();
  TaxelFlags counted(taxels());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    counted[taxel] = !ignored()[taxel];
  }
  if (blocks_.full()) {
    rest_noise_.observe_steps(blocks_, *belief(), counted, at_rest && comparable);
  }
  if (!at_rest || !comparable || block.touched.any()) {
    rest_noise_.pause();
  } else {
    const double known = rest_noise_.walk().intensity();
    rest_noise_.observe_walk(blocks_, *belief(), counted);
    propagation_.admit_walk(filter_, rest_noise_.walk().intensity(), known, age());
  }
}

/// Find a taxel whose force drifts alone: its signal has stepped, at some time since it was last known to be still.
/// Correct its errors. Not where warmth may be all of a force, which it keeps up as it comes and goes.
void ForceEstimator::observe_lone_drift(const Block& block) {
  if (touched_forces_.hidden_share(*belief()) > kHides) {
    lone_drift_.restart();
    return;
  }
  double noise = 0.0;
  TaxelFlags counted(taxels());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    counted[taxel] = !ignored()[taxel] && !lower_bound_.mask()[taxel] && offset_known()[taxel];
    noise = counted[taxel] ? std::max(noise, block.noise[taxel]) : noise;
  }
  const auto found =
      lone_drift_.observe(mean_.data(), counted.data(), block.listed.data(), block.touched.data(), noise, block.span);
  if (!found) {
    return;
  }
  const double step = found->rate * integration_->time_constant(found->taxel);
  double* error = belief()->error_of(found->taxel);
  error[kOffset] += step;
  error[kForceError] += step + 0.5 * (found->earliest + found->latest) * found->rate;
  belief()->own_of(found->taxel)[own_at(kForceError, kForceError)] +=
      square((found->earliest - found->latest) * found->rate) / 12.0;
  rest_noise_.admit_step(found->taxel, step);
  forget_blocks();  // to process them again would undo it
}

}  // namespace posfet
