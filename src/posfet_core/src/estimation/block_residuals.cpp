// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/block_residuals.hpp"

#include <algorithm>
#include <array>

#include "force_estimator_constants.hpp"
#include "posfet_core/estimation/hot_film.hpp"
#include "posfet_core/numbers.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

namespace {

/// Variance of the force of a taxel beside a contact in a block, in addition to shares of its neighbours' [N2]: 0.1 mN
/// that stays the same for 50 blocks, a second.
constexpr double kTailNoise = 5e-7;

}  // namespace

BlockResiduals::BlockResiduals(const EstimatedArray& array) : array_(array) {
  for (auto* values : {&measured_, &noise_, &values_, &deviation_, &own_deviation_}) {
    values->assign(array_.taxels(), 0.0);
  }
  for (auto* values : {&response_, &sensitivity_}) {
    values->assign(array_.taxels() * kSharedStates, 0.0);
  }
}

void BlockResiduals::expect_small_forces(const Block& block, const Belief& belief, const TouchResponse& touch) {
  measured_ = block.mean;
  response_ = block.response;
  noise_ = block.noise;
  for (std::size_t taxel = 0; taxel < noise_.size(); ++taxel) {
    if (!block.is_small(taxel)) {
      continue;
    }
    // What the shared states predict of the small force stays subtracted, as it is from the force.
    double* response = response_.data() + taxel * kSharedStates;
    for (std::size_t state = 0; state < kSharedStates; ++state) {
      if (is_of_touch(state)) {
        measured_[taxel] -= response[state] * belief.shared[state];
        response[state] = 0.0;
      }
    }
    response[kTail] = block.tail[taxel];
    // As the contact moves, what is warm moves with it.
    noise_[taxel] += touch.warmth_variance(taxel, belief.shared[kWarmth]) + kTailNoise +
                     square(array_.priors.tail_change * block.neighbour[taxel]);
  }
}

void BlockResiduals::expect_release(const Block& block) {
  measured_ = block.mean;
  response_ = block.response;
  std::transform(block.noise.begin(), block.noise.end(), noise_.begin(),
                 [](double noise) { return noise + kTailNoise; });
}

void BlockResiduals::compare(const ForceErrorFilter& filter) {
  filter.innovation(measured_.data(), response_.data(), noise_.data(), values_.data(), sensitivity_.data(),
                    deviation_.data());
  for (std::size_t taxel = 0; taxel < noise_.size(); ++taxel) {
    own_deviation_[taxel] = std::sqrt(filter.belief()->own_variance(taxel) + noise_[taxel]);
  }
}

void BlockResiduals::take_forces(const ForceErrorFilter& filter, const Block& block) {
  filter.forces(block.mean.data(), block.response.data(), values_.data());
}

void BlockResiduals::admit_warming(double kelvin) {
  for (std::size_t taxel = 0; taxel < noise_.size(); ++taxel) {
    noise_[taxel] += square(array_.priors.pyroelectric * kelvin * array_.newton_per_kelvin[taxel]);
  }
}

bool BlockResiduals::is_odd(std::size_t taxel) const { return std::abs(values_[taxel]) > kGate * deviation_[taxel]; }

bool BlockResiduals::is_odd(std::size_t taxel, double kelvin) const {
  return std::abs(values_[taxel] - kelvin * array_.newton_per_kelvin[taxel]) > kGate * own_deviation_[taxel];
}

void BlockResiduals::admit_warmer_object(ForceErrorFilter& filter, const TaxelFlags& zeros,
                                         const TouchResponse& touch) {
  std::array<double, kSharedStates> sensitivity{};  // of the sum of the zeros by their weight
  double sum = 0.0;
  for (std::size_t taxel = 0; taxel < noise_.size(); ++taxel) {
    const double* own = sensitivity_.data() + taxel * kSharedStates;
    const bool warm = std::abs(own[kWarmth]) > HotFilm::kWarmed * std::abs(array_.newton_per_kelvin[taxel]);
    if (zeros[taxel] && warm) {
      const double weight = own[kWarmth] / square(own_deviation_[taxel]);
      sum += weight * values_[taxel];
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
  const double expected = (filter.shared_variance(sensitivity.data()) + information) / square(information);
  const double differs = touch.warmth_difference(filter.belief()->shared[kWarmth]);
  if (change * array_.per_kelvin < 0.0 && square(change) > square(kGate) * (expected + square(differs))) {
    filter.widen(direction_of(kWarmth).data(), square(change));
    compare(filter);
  }
}

void BlockResiduals::update(ForceErrorFilter& filter, const TaxelFlags& where) const {
  filter.update(where.data(), values_.data(), sensitivity_.data(), noise_.data());
}

void BlockResiduals::update_alone(ForceErrorFilter& filter, const TaxelFlags& where) const {
  Vector<double> left(noise_.size());
  filter.residuals(measured_.data(), response_.data(), left.data());
  filter.update_alone(where.data(), left.data(), sensitivity_.data(), noise_.data());
}

void BlockResiduals::find_left(const ForceErrorFilter& filter, const TaxelFlags& updated, double rate, double time,
                               double* left) const {
  const double unknown = array_.priors.pyroelectric * rate * time;
  Vector<double> unmodelled(noise_.size());
  for (std::size_t taxel = 0; taxel < noise_.size(); ++taxel) {
    unmodelled[taxel] = square(array_.newton_per_kelvin[taxel] * unknown);
  }
  filter.post_fit(updated.data(), measured_.data(), response_.data(), noise_.data(), unmodelled.data(), left);
}

}  // namespace posfet
