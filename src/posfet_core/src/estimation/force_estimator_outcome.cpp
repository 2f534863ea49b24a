// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// What holds until the end of the next block: correction, covariance and validity.

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

/// Force above which a taxel is not valid [greatest force]: one of a small gain shows more than the nominal one.
constexpr double kBeyondRange = 1.25;

/// Warmth of touched taxels, with its deviation, above which their forces are not valid [K]: force and warmth are
/// hardly separable then.
constexpr double kGreatestWarmth = 0.08;

/// Change of the gain per force on a taxel [1/N], assumed: with the preload of the film, the charge per small force
/// grows by up to two per cent per newton, half of which counts for the force itself.
constexpr double kNonlinearity = 0.01;

/// Blocks in which the array must have been still before offsets count as known [1]: 0.1 s.
constexpr std::size_t kSettledBlocks = 5;

/// Variance of a pyroelectric response that is known exactly [1]: not 0, to divide by.
constexpr double kNegligibleResponse = 1e-12;

}  // namespace

/// Set the correction of the next scans, covariance and validity.
void ForceEstimator::finish(const Block& block) {
  const Belief& b = *belief();
  ForceIntegration::State& s = state();
  const double rate = film_rate();
  std::vector<double>& predicted = values_;
  filter_.predicted(block.response.data(), predicted.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double leaking = offset(taxel) / present_time_constant(taxel);
    const double response = array_.newton_per_kelvin[taxel] * (1.0 + b.error_of(taxel)[kPyroelectric]);
    s.rate[taxel] = leaking + response * rate;
    s.correction[taxel] = predicted[taxel] + touch_.loops()[taxel] + 0.5 * block.duration * s.rate[taxel];
    s.force[taxel] = s.raw[taxel] - s.correction[taxel];
    mean_[taxel] = block.mean[taxel] - predicted[taxel];
    if (listed_[taxel] || !offset_known()[taxel]) {
      absorbed_.touch(taxel);
    }
  }
  absorbed_.follow(block, b, rate, beside_);
  set_covariance(block);
  find_hot_touch();
  recovering_ = std::max(0.0, recovering_ - block.duration);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    chosen_[taxel] = !(std::abs(s.force[taxel]) <= kRunaway * array_.greatest_force);  // NaN, too
    restarts_ += chosen_[taxel] && !ignored()[taxel] ? 1 : 0;
  }
  restart(chosen_);
  confirm_offsets(block.duration);
  integration_->block().valid = is_valid(block.duration);
  prepare_compensation(block);
  start_block();
}

/// Find what zeros may have taken of a slow press. It counts in the deviation only: the filter would explain the rest
/// of the press by it.
void ForceEstimator::find_absorbed() {
  TaxelFlags& untouched = odd_;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    untouched[taxel] = uniform_.observable() && !touched_[taxel] && !ignored()[taxel];
  }
  absorbed_.find(*belief(), untouched);
}

void ForceEstimator::set_covariance(const Block& block) {
  const Belief& b = *belief();
  ForceIntegration::State& s = state();
  std::vector<double>& shared_variance = values_;
  find_absorbed();
  hidden_.follow(block, b, {mean_, absorbed_.values(), touched_, !listed_.any()}, surroundings_);
  filter_.covariance_root(block.response.data(), own_.data(), response_.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    double* sensitivity = sensitivity_.data() + taxel * kSharedStates;
    for (std::size_t state = 0; state < kSharedStates; ++state) {
      const double response = is_of_touch(state) ? 0.0 : block.response[taxel * kSharedStates + state];
      sensitivity[state] = response + b.slope_of(taxel, kForceError)[state];
    }
  }
  filter_.shared_variance(sensitivity_.data(), shared_variance.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double held = touched_[taxel] && counts(taxel) ? std::max(s.force[taxel], 0.0) : 0.0;
    s.held[taxel] = held;
    const double* own = b.own_of(taxel);
    double& lost = s.lost[taxel];
    lost = touched_[taxel] ? lost : 0.0;
    double* factor = s.correlated_error.data() + taxel * kCauses;
    std::copy_n(response_.data() + taxel * kSharedStates, kSharedStates, factor);
    factor[kSharedStates] = held * std::hypot(array_.common_gain_deviation, kNonlinearity * held);
    factor[kSharedStates + 1] = array_.newton_per_kelvin[taxel] * unconfirmed_;
    factor[kSharedStates + 2] = absorbed_.values()[taxel] + hidden_.values()[taxel];
    factor[kOfObject] = object_deviation(taxel);
    factor[kSharedStates + 4] = lost;
    // The covariance without the responses to the touch itself, and without what the taxel's own response to a
    // temperature contributes, which grows during a touch only.
    const double by_response = square(own[own_at(kForceError, kPyroelectric)]) /
                               std::max(own[own_at(kPyroelectric, kPyroelectric)], kNegligibleResponse);
    const double by_warmth = !beside_[taxel] || own[own_at(kOwnWarmth, kOwnWarmth)] <= 0.0
                                 ? 0.0
                                 : square(own[own_at(kForceError, kOwnWarmth)]) / own[own_at(kOwnWarmth, kOwnWarmth)];
    untouched_variance_[taxel] = std::max(own_[taxel] - by_response - by_warmth, 0.0) + shared_variance[taxel];
    own_[taxel] -= std::min(own_[taxel], square(lost));  // in the covariance as each taxel's own
    own_[taxel] +=
        square(array_.gain_deviation[taxel] * held) + square(array_.leak_deviation[taxel] * touch_.leaked(taxel));
  }
}

/// Deviation of a force by what the warmth of the object that touches may differ from that of others [N], beyond what
/// is unknown of that. It counts in the covariance only: as a state, it would make the common warmth follow each
/// object, and all that is wrong with the assumed thermal contact.
double ForceEstimator::object_deviation(std::size_t taxel) const {
  if (!touched_[taxel]) {
    return 0.0;
  }
  const double unknown = std::sqrt(std::max(square(warmth_difference()) - belief()->variance(kWarmth), 0.0));
  return array_.newton_per_kelvin[taxel] * touch_.warm()[taxel] * unknown;
}

/// Whether the forces are valid at the end of a block.
bool ForceEstimator::is_valid(double duration) {
  bool sound = true;
  bool may_touch = std::abs(unconfirmed_) > negligible();
  double total = 0.0;
  double warmed = 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    warmed += std::abs(array_.newton_per_kelvin[taxel] * belief()->shared[kWarmth] * touch_.warm()[taxel]);
    const bool fit = offset_known()[taxel] && unexplained_.below()[taxel] == 0.0 && !lower_bound_.mask()[taxel] &&
                     force()[taxel] <= kBeyondRange * array_.greatest_force;
    sound = sound && (fit || ignored()[taxel]);
    chosen_[taxel] = counts(taxel);
    may_touch = may_touch || (touched_[taxel] && chosen_[taxel]);
    total += chosen_[taxel] ? force()[taxel] : 0.0;
  }
  certainty_.add(total);
  may_touch = may_touch || warmed > array_.threshold || refutation_.wide();
  double deviation = 0.0;
  if (may_touch) {
    deviation = total_deviation(chosen_);
    refutation_.end_block(duration, total, deviation);
  }
  const bool unknown_zero = touch_at_start && !zero_known_;
  if (unknown_zero || recovering_ > 0.0 || !sound) {
    return false;
  }
  return !may_touch || is_certain(chosen_, deviation);
}

/// Find whether what touches is so hot that force and warmth are hardly separable: no object pulls, yet the force of
/// all contacts is below zero by more than less warmth explains.
void ForceEstimator::find_hot_touch() {
  double total = 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    chosen_[taxel] = listed_[taxel] && counts(taxel);
    zeros_[taxel] = chosen_[taxel] && mean_[taxel] < -array_.threshold;
    total += chosen_[taxel] ? mean_[taxel] : 0.0;
    total += zeros_[taxel] ? kGreatestWarmth * std::abs(array_.newton_per_kelvin[taxel]) : 0.0;
  }
  if (zeros_.any() && total < -kGate * total_deviation(chosen_)) {
    hot_film_.find_warm(touch_.warm(), beside_, surroundings_);
    hot_film_.explains(zeros_, mean_, array_.newton_per_kelvin);
  }
}

/// Whether what touches may have warmed the film so much that force and warmth are hardly separable.
bool ForceEstimator::may_be_hot() const {
  return hot_film_.hot() ||
         std::abs(belief()->shared[kWarmth]) + std::sqrt(belief()->variance(kWarmth)) > kGreatestWarmth;
}

/// Standard deviation of the total force of these taxels [N].
double ForceEstimator::total_deviation(const TaxelFlags& counted) const {
  double variance = 0.0;
  std::array<double, kCauses> shared{};
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (counted[taxel]) {
      variance += own_[taxel];
      for (std::size_t cause = 0; cause < kCauses; ++cause) {
        shared[cause] += state().correlated_error[taxel * kCauses + cause];
      }
    }
  }
  return std::sqrt(variance + dot(shared.data(), shared.data(), kCauses));
}

/// Whether the total force of these taxels is certain enough while something touches, or may.
bool ForceEstimator::is_certain(const TaxelFlags& counted, double deviation) const {
  double noise = 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    noise += counted[taxel] ? noise_variance_[taxel] : 0.0;
  }
  return !may_be_hot() && certainty_.is_certain(deviation, std::sqrt(noise), max_relative_uncertainty);
}

/// Mark offsets as known once the array has been still.
void ForceEstimator::confirm_offsets(double duration) {
  if (state().knows_offsets()) {
    return;
  }
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    values_[taxel] = signal(taxel);
    chosen_[taxel] = !offset_known()[taxel] && !ignored()[taxel];
  }
  // What all taxels have in common may be the film's temperature: judged by `UniformChange`, and no motion.
  const bool warms = square(belief()->shared[kRate]) > square(kSurprising) * belief()->variance(kRate);
  const bool at_rest = rest_.update(values_.data(), ignored().data(), duration, uniform_.observable() || warms);
  if (rest_.moved()) {
    restart(chosen_);
  } else if (at_rest && blocks_.size() >= kSettledBlocks) {
    for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
      const double certain = square(0.5 * array_.threshold * array_.time_constant[taxel]);
      const bool known = belief()->own_of(taxel)[own_at(kOffset, kOffset)] <= certain && !ignored()[taxel];
      state().offset_known[taxel] = state().offset_known[taxel] || known;
    }
  }
}

/// Choose the untouched taxels that show the film's temperature scan by scan during a touch. Their small forces stay as
/// they are until the next block. The share of a uniform change that is the film's is the gain of the Kalman filter of
/// a random walk, in its limits of much and of little noise.
void ForceEstimator::prepare_compensation(const Block& block) {
  Taxels untouched;
  double noise = 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (!touched_[taxel] && !ignored()[taxel] && offset_known()[taxel]) {
      values_[untouched.size()] = mean_[taxel];
      untouched.push_back(static_cast<Taxel>(taxel));
      noise += noise_variance_[taxel];
    }
  }
  // Fewer than half of the taxels are all at the edge of what touches, and change with it.
  const std::size_t enough = std::max(kFewestForUniform, taxels() / 2);
  if (!touched_.any() || !uniform_.observable() || untouched.size() < enough) {
    integration_->watch_none();
    return;
  }
  const auto count = static_cast<double>(untouched.size());
  const double deviation = std::sqrt(noise / count / count);
  const double walk =
      std::abs(mean_per_kelvin()) * std::sqrt(belief()->variance(kRate)) * block.duration / integration_->block().scans;
  integration_->watch(untouched, values_.data(), walk / (walk + deviation));
}

}  // namespace posfet
