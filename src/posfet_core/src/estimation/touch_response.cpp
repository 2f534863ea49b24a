// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/touch_response.hpp"

#include <algorithm>
#include <cmath>

#include "posfet_core/numbers.hpp"
#include "posfet_core/product.hpp"

namespace posfet {

namespace {

/// What thermal contact lacks to be whole [1], by the force relative to that at which it saturates.
double without(double force, double steepness) { return std::exp(-std::pow(force, steepness)); }

}  // namespace

void TouchResponse::reset() {
  for (auto* values : {&charge_, &force_, &warm_, &certain_, &range_, &loops_}) {
    values->assign(taxels(), 0.0);
  }
  for (auto& values : followed_) {
    values.assign(taxels(), 0.0);
  }
  for (auto& values : plays_) {
    values.assign(taxels(), 0.0);
  }
  warmed_.fill(0.0);
  warming_ = 0.0;
  responding_ = false;
}

void TouchResponse::advance(const std::vector<double>& force, const std::vector<double>& least,
                            const std::vector<double>& most, double duration, const Known& known) {
  responding_ = responding_ || std::any_of(force.begin(), force.end(), [](double each) { return each != 0.0; });
  if (!responding_) {
    return;
  }
  const ErrorPriors& priors = array_->priors;
  for (std::size_t creep = 0; creep < kCreeps; ++creep) {
    const double share = -std::expm1(-duration / priors.creep_times[creep]);
    for (std::size_t taxel = 0; taxel < force.size(); ++taxel) {
      followed_[creep][taxel] += share * (force[taxel] - followed_[creep][taxel]);
    }
  }
  follow_loops(force);
  const double total = sum(force);
  warming_ = 0.0;
  for (std::size_t each = 0; each < kWarmings; ++each) {
    const double follows = -std::expm1(-duration / priors.chip_times[each]) * (total - warmed_[each]);
    warmed_[each] += follows;
    warming_ += priors.chip_warming[each] * (follows / duration);
  }
  const double warming = -std::expm1(-duration / priors.warmth_time);
  const double saturating = priors.warmth_force;
  const double steep = priors.warmth_steepness;
  for (std::size_t taxel = 0; taxel < force.size(); ++taxel) {
    const double ratio = duration / (array_->time_constant[taxel] * (1.0 + known.leak));
    const double left = std::exp(-ratio);
    charge_[taxel] = charge_[taxel] * left + (force[taxel] - force_[taxel]) * (1.0 - left) / ratio;
    force_[taxel] = force[taxel];
    // The thermal contact saturates. By what a force seems to be it is no more than keeps no force up: a film that
    // warms hides at most as much of a force as there is; nor is it steep, then: at a force that may be wrong by as
    // much, steep contacts are any on average. What a force is at least has all of it.
    const double self = std::max(saturating, -array_->newton_per_kelvin[taxel] * known.warmth);
    const double steepness = std::max(steep * square(saturating / self), std::min(steep, 1.0));
    const double certain = priors.warmth_certain * (1.0 - without(least[taxel] / saturating, steep));
    const double contact = std::max(1.0 - without(force[taxel] / self, steepness), certain);
    certain_[taxel] += warming * (certain - certain_[taxel]);
    warm_[taxel] += warming * (contact - warm_[taxel]);
    const double range =
        without(least[taxel] / self, steepness) - without(most[taxel] * priors.warmth_force_spread / saturating, steep);
    range_[taxel] += warming * (range - range_[taxel]);
  }
}

/// Drag the play operators along, never further than their half width from the force.
void TouchResponse::follow_loops(const std::vector<double>& force) {
  for (std::size_t taxel = 0; taxel < force.size(); ++taxel) {
    loops_[taxel] = -array_->priors.loop_slope * force[taxel];
    for (std::size_t loop = 0; loop < kLoops; ++loop) {
      double& play = plays_[loop][taxel];
      const double half = array_->priors.loop_half_widths[loop];
      play = std::min(std::max(play, force[taxel] - half), force[taxel] + half);
      loops_[taxel] += array_->priors.loop_weights[loop] * (force[taxel] - play);
    }
  }
}

double TouchResponse::warmth_difference(double warmth) const {
  return array_->priors.warmth_least + array_->priors.warmth_spread * std::abs(warmth);
}

double TouchResponse::warmth_variance(std::size_t taxel, double warmth) const {
  const double own = warmth_difference(warmth) * warm_[taxel];
  const double contact = array_->priors.warmth_contact * std::abs(warmth) * range_[taxel];
  return square(array_->newton_per_kelvin[taxel]) * (square(own) + square(contact));
}

void TouchResponse::reduce_warmth(std::size_t taxel, double left, double warmth) {
  const double per_warm = -array_->newton_per_kelvin[taxel] * warmth;
  if (left > 0.0 && per_warm > 0.0 && array_->priors.warmth_certain > 0.0) {
    const double own = std::min(left, per_warm * std::max(warm_[taxel] - certain_[taxel], 0.0));
    warm_[taxel] -= own / per_warm;
  }
}

void TouchResponse::matrix(double* response) const {
  std::fill_n(response, taxels() * kSharedStates, 0.0);
  const double total = sum(force_);
  const double moment_x = dot(force_.data(), array_->x.data(), force_.size());
  const double moment_y = dot(force_.data(), array_->y.data(), force_.size());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    double* row = response + taxel * kSharedStates;
    row[kFilm] = array_->newton_per_kelvin[taxel];
    row[kBend] = total * array_->priors.bend_profile[taxel];
    row[kBendX] = total * array_->x[taxel];
    row[kBendY] = total * array_->y[taxel];
    row[kBendMoment] = moment_x * array_->x[taxel] + moment_y * array_->y[taxel];
    row[kLeak] = leaked(taxel);
    row[kWarmth] = array_->newton_per_kelvin[taxel] * warm_[taxel];
    row[kWeakWarmth] = array_->newton_per_kelvin[taxel] * range_[taxel];
    for (std::size_t creep = 0; creep < kCreeps; ++creep) {
      row[kCreep + creep] = followed_[creep][taxel];
    }
  }
}

}  // namespace posfet
