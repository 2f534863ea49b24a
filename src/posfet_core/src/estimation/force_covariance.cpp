// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/force_covariance.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "force_estimator_constants.hpp"
#include "posfet_core/numbers.hpp"
#include "posfet_core/product.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

namespace {

/// Change of the gain per force on a taxel [1/N], assumed: with the preload of the film, the charge per small force
/// grows by up to two per cent per newton, half of which counts for the force itself.
constexpr double kNonlinearity = 0.01;

/// Variance of a pyroelectric response that is known exactly [1]: not 0, to divide by.
constexpr double kNegligibleResponse = 1e-12;

/// By how much the warmth of the object that touches may differ from that of others beyond what is unknown of that [K].
/// It counts in the covariance only: as a state, it would make the common warmth follow each object, and all that is
/// wrong with the assumed thermal contact.
double object_difference(const Belief& belief, const TouchResponse& touch) {
  const double difference = touch.warmth_difference(belief.shared[kWarmth]);
  return std::sqrt(std::max(square(difference) - belief.variance(kWarmth), 0.0));
}

/// What of the variance of a force is without a touch its own: not what its own response to a temperature contributes,
/// which grows during a touch only, nor its own warmth, beside a touch.
double untouched_part(double variance, const double* own, bool beside) {
  const double by_response = square(own[own_at(kForceError, kPyroelectric)]) /
                             std::max(own[own_at(kPyroelectric, kPyroelectric)], kNegligibleResponse);
  const double by_warmth = !beside || own[own_at(kOwnWarmth, kOwnWarmth)] <= 0.0
                               ? 0.0
                               : square(own[own_at(kForceError, kOwnWarmth)]) / own[own_at(kOwnWarmth, kOwnWarmth)];
  return std::max(variance - by_response - by_warmth, 0.0);
}

}  // namespace

ForceCovariance::ForceCovariance(const EstimatedArray& array, const ContactSurroundings& surroundings,
                                 ForceIntegration::State& integrated)
    : array_(array),
      integrated_(integrated),
      hidden_(array, surroundings),
      own_(array.taxels(), 0.0),
      untouched_(array.taxels(), 0.0) {}

void ForceCovariance::update(const Block& block, const Known& known) {
  const Belief& b = *known.filter.belief();
  hidden_.follow(block, b, {known.mean, known.absorbed, known.touched, !known.listed});
  Vector<double> factor(own_.size() * kSharedStates);
  known.filter.covariance_root(block.response.data(), own_.data(), factor.data());
  Vector<double> sensitivity(own_.size() * kSharedStates);  // of the forces but for a touch
  for (std::size_t taxel = 0; taxel < own_.size(); ++taxel) {
    const std::size_t row = taxel * kSharedStates;
    std::copy_n(factor.data() + row, kSharedStates, integrated_.correlated_error.data() + taxel * kCauses);
    for (std::size_t each = 0; each < kSharedStates; ++each) {
      const double response = is_of_touch(each) ? 0.0 : block.response[row + each];
      sensitivity[row + each] = response + b.slope_of(taxel, kForceError)[each];
    }
  }
  Vector<double> shared_variance(own_.size());
  known.filter.shared_variance(sensitivity.data(), shared_variance.data());
  const double object = object_difference(b, known.touch);
  for (std::size_t taxel = 0; taxel < own_.size(); ++taxel) {
    add_causes(taxel, known, object);
    untouched_[taxel] = untouched_part(own_[taxel], b.own_of(taxel), known.beside[taxel]) + shared_variance[taxel];
    own_[taxel] -= std::min(own_[taxel], square(integrated_.lost[taxel]));  // in the covariance as each taxel's own
    own_[taxel] += square(array_.gain_deviation[taxel] * integrated_.held[taxel]) +
                   square(array_.leak_deviation[taxel] * known.touch.leaked(taxel));
  }
}

/// Set what the causes beside the shared states contribute to the factor of a taxel.
void ForceCovariance::add_causes(std::size_t taxel, const Known& known, double object) const {
  double* factor = integrated_.correlated_error.data() + taxel * kCauses;
  const double response = array_.newton_per_kelvin[taxel];
  const double held = integrated_.held[taxel];
  factor[kOfGain] = held * std::hypot(array_.common_gain_deviation, kNonlinearity * held);
  factor[kOfWarmerFilm] = response * known.unconfirmed;
  factor[kOfSlowPress] = known.absorbed[taxel] + hidden_.values()[taxel];
  factor[kOfObject] = known.touched[taxel] ? response * known.touch.warm()[taxel] * object : 0.0;
  factor[kOfLostScans] = integrated_.lost[taxel];
}

double ForceCovariance::of_motion(std::size_t taxel) const {
  const double* factor = integrated_.correlated_error.data() + taxel * kCauses;
  return own_[taxel] + dot(factor, factor, kCauses) - square(factor[kOfObject]);
}

double ForceCovariance::total_deviation(const TaxelFlags& counted) const {
  double variance = 0.0;
  std::array<double, kCauses> shared{};
  for (std::size_t taxel = 0; taxel < own_.size(); ++taxel) {
    if (counted[taxel]) {
      variance += own_[taxel];
      add_scaled(1.0, integrated_.correlated_error.data() + taxel * kCauses, shared.data(), kCauses);
    }
  }
  return std::sqrt(variance + dot(shared.data(), shared.data(), kCauses));
}

}  // namespace posfet
