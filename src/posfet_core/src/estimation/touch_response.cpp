// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/touch_response.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "posfet_core/numbers.hpp"
#include "posfet_core/product.hpp"

namespace posfet {

namespace {

/// What thermal contact lacks to be whole [1], by the force relative to that at which it saturates.
double without(double force, double steepness) { return std::exp(-std::pow(force, steepness)); }

}  // namespace

TouchResponse::TouchResponse(const Layout& layout, std::vector<double> time_constant,
                             std::vector<double> newton_per_kelvin, ErrorPriors priors)
    : tau_(std::move(time_constant)), per_kelvin_(std::move(newton_per_kelvin)), priors_(std::move(priors)) {
  const auto place = [](Taxel index, Taxel count) {
    const double half = 0.5 * static_cast<double>(count - 1);
    return (static_cast<double>(index) - half) / std::max(half, 0.5);
  };
  for (Taxel taxel = 0; taxel < layout.rows * layout.cols; ++taxel) {
    x_.push_back(place(taxel % layout.cols, layout.cols));
    y_.push_back(place(taxel / layout.cols, layout.rows));
  }
  std::vector<double>& profile = priors_.bend_profile;
  if (profile.empty()) {
    profile.assign(x_.size(), 1.0);
  }
  if (profile.size() != x_.size()) {
    throw std::invalid_argument("bend_profile must have one value for each taxel, or none");
  }
  reset();
}

void TouchResponse::reset() {
  for (auto* values : {&charge_, &force_, &warm_, &certain_, &range_, &loops_}) {
    values->assign(tau_.size(), 0.0);
  }
  for (auto& values : followed_) {
    values.assign(tau_.size(), 0.0);
  }
  for (auto& values : plays_) {
    values.assign(tau_.size(), 0.0);
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
  for (std::size_t creep = 0; creep < kCreeps; ++creep) {
    const double share = -std::expm1(-duration / priors_.creep_times[creep]);
    for (std::size_t taxel = 0; taxel < force.size(); ++taxel) {
      followed_[creep][taxel] += share * (force[taxel] - followed_[creep][taxel]);
    }
  }
  follow_loops(force);
  const double total = sum(force);
  warming_ = 0.0;
  for (std::size_t each = 0; each < kWarmings; ++each) {
    const double follows = -std::expm1(-duration / priors_.chip_times[each]) * (total - warmed_[each]);
    warmed_[each] += follows;
    warming_ += priors_.chip_warming[each] * (follows / duration);
  }
  const double warming = -std::expm1(-duration / priors_.warmth_time);
  const double saturating = priors_.warmth_force;
  const double steep = priors_.warmth_steepness;
  for (std::size_t taxel = 0; taxel < force.size(); ++taxel) {
    const double ratio = duration / (tau_[taxel] * (1.0 + known.leak));
    const double left = std::exp(-ratio);
    charge_[taxel] = charge_[taxel] * left + (force[taxel] - force_[taxel]) * (1.0 - left) / ratio;
    force_[taxel] = force[taxel];
    // The thermal contact saturates. By what a force seems to be it is no more than keeps no force up: a film that
    // warms hides at most as much of a force as there is; nor is it steep, then: at a force that may be wrong by as
    // much, steep contacts are any on average. What a force is at least has all of it.
    const double self = std::max(saturating, -per_kelvin_[taxel] * known.warmth);
    const double steepness = std::max(steep * square(saturating / self), std::min(steep, 1.0));
    const double certain = priors_.warmth_certain * (1.0 - without(least[taxel] / saturating, steep));
    const double contact = std::max(1.0 - without(force[taxel] / self, steepness), certain);
    certain_[taxel] += warming * (certain - certain_[taxel]);
    warm_[taxel] += warming * (contact - warm_[taxel]);
    const double range = without(least[taxel] / self, steepness) -
                         without(most[taxel] * priors_.warmth_force_spread / saturating, steep);
    range_[taxel] += warming * (range - range_[taxel]);
  }
}

/// Drag the play operators along, never further than their half width from the force.
void TouchResponse::follow_loops(const std::vector<double>& force) {
  for (std::size_t taxel = 0; taxel < force.size(); ++taxel) {
    loops_[taxel] = -priors_.loop_slope * force[taxel];
    for (std::size_t loop = 0; loop < kLoops; ++loop) {
      double& play = plays_[loop][taxel];
      const double half = priors_.loop_half_widths[loop];
      play = std::min(std::max(play, force[taxel] - half), force[taxel] + half);
      loops_[taxel] += priors_.loop_weights[loop] * (force[taxel] - play);
    }
  }
}

double TouchResponse::warmth_difference(double warmth) const {
  return priors_.warmth_least + priors_.warmth_spread * std::abs(warmth);
}

double TouchResponse::warmth_variance(std::size_t taxel, double warmth) const {
  const double own = warmth_difference(warmth) * warm_[taxel];
  const double contact = priors_.warmth_contact * std::abs(warmth) * range_[taxel];
  return square(per_kelvin_[taxel]) * (square(own) + square(contact));
}

void TouchResponse::reduce_warmth(std::size_t taxel, double left, double warmth) {
  const double per_warm = -per_kelvin_[taxel] * warmth;
  if (left > 0.0 && per_warm > 0.0 && priors_.warmth_certain > 0.0) {
    const double own = std::min(left, per_warm * std::max(warm_[taxel] - certain_[taxel], 0.0));
    warm_[taxel] -= own / per_warm;
  }
}

void TouchResponse::matrix(double* response) const {
  std::fill_n(response, tau_.size() * kSharedStates, 0.0);
  const double total = sum(force_);
  const double moment_x = dot(force_.data(), x_.data(), force_.size());
  const double moment_y = dot(force_.data(), y_.data(), force_.size());
  for (std::size_t taxel = 0; taxel < tau_.size(); ++taxel) {
    double* row = response + taxel * kSharedStates;
    row[kFilm] = per_kelvin_[taxel];
    row[kBend] = total * priors_.bend_profile[taxel];
    row[kBendX] = total * x_[taxel];
    row[kBendY] = total * y_[taxel];
    row[kBendMoment] = moment_x * x_[taxel] + moment_y * y_[taxel];
    row[kLeak] = leaked(taxel);
    row[kWarmth] = per_kelvin_[taxel] * warm_[taxel];
    row[kWeakWarmth] = per_kelvin_[taxel] * range_[taxel];
    for (std::size_t creep = 0; creep < kCreeps; ++creep) {
      row[kCreep + creep] = followed_[creep][taxel];
    }
  }
}

}  // namespace posfet
