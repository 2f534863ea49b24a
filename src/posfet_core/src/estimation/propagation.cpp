// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/propagation.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "force_estimator_constants.hpp"
#include "posfet_core/estimation/temperature_walk.hpp"
#include "posfet_core/numbers.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

namespace {

/// Variance of a common tail of which nothing is known [1], assumed: as after all the force has moved from taxel to
/// taxel. What is beside a contact rises on all of its side at once as it comes.
constexpr double kUnknownTail = 0.15;

/// Greatest change of the logarithm of the sensors' lag by one reading [1]: the lag is nearly linear in it, then.
constexpr double kLargestLagStep = 0.5;

/// Time in which readings show at what rate the film has warmed since before the start [s]: it is constant.
constexpr double kEarly = 2.0;

bool is_surprising(const TemperatureInnovation& found) {
  return square(found.innovation) > square(kSurprising) * found.variance;
}

}  // namespace

Propagation::Propagation(const EstimatedArray& array, bool observable)
    : array_(array), observable_(observable), dynamics_(array.priors, array.film_lag) {}

void Propagation::predict(ForceErrorFilter& filter, const Block& block) {
  Belief& b = *filter.belief();
  const std::size_t taxels = b.taxels();
  TaxelFlags elsewhere(taxels);
  for (std::size_t taxel = 0; taxel < taxels; ++taxel) {
    elsewhere[taxel] = !block.is_small(taxel);
  }
  b.forget_small_forces(elsewhere.data());
  Vector<double> own_noise(block.own_noise.begin(), block.own_noise.end());
  const double spread = tail_spread(array_.priors, b);
  for (std::size_t taxel = 0; taxel < taxels; ++taxel) {
    const std::size_t place = taxel * kOwnStates * kOwnStates + own_at(kSmallForce, kSmallForce);
    if (block.is_small(taxel) && b.own[place] == 0.0) {  // beside the contact since now
      own_noise[place] = square(spread * block.tail[taxel] + array_.priors.tail_least * block.neighbour[taxel]);
    }
  }
  SharedTransition& shared = dynamics_.transition(b.shared, block.span, block.warming);
  expect_tail(shared, b, block);
  shared.noise[kRate * kSharedStates + kRate] += block.rate_noise;
  shared.noise[kLeak * kSharedStates + kLeak] += block.leak_noise;
  const double warming = shared.after[kFilm] - b.shared[kFilm];
  Vector<double> warmed(taxels);
  Vector<double> leaked(taxels);
  Vector<double> driven(taxels * kSharedStates);
  for (std::size_t taxel = 0; taxel < taxels; ++taxel) {
    warmed[taxel] = array_.newton_per_kelvin[taxel] * warming;
    leaked[taxel] = block.span * block.leak / array_.time_constant[taxel];
    driven[taxel * kSharedStates + kDrift] = block.span * block.leak;
  }
  b.respond(warmed.data());
  b.cool(block.cooled.data());
  filter.predict(
      {shared.after.data(), shared.matrix.data(), shared.noise.data(), leaked.data(), driven.data(), own_noise.data()});
}

/// Let the tail change by as much as it is as the forces beside the contact change.
void Propagation::expect_tail(SharedTransition& shared, const Belief& belief, const Block& block) const {
  const double forgotten =
      block.moved_share + 0.5 * square(tail_spread(array_.priors, belief)) / kUnknownTail * block.tail_moved;
  const double kept = std::exp(-forgotten);
  shared.matrix[kTail * kSharedStates + kTail] = kept;
  shared.after[kTail] = array_.priors.tail + kept * (belief.shared[kTail] - array_.priors.tail);
  shared.noise[kTail * kSharedStates + kTail] = (1.0 - square(kept)) * kUnknownTail;
}

Propagation::Contradiction Propagation::measure_temperature(ForceErrorFilter& filter, const Block& block, bool zeros) {
  if (std::isnan(block.reading)) {
    return {0.0, 0.0, 0.0, 0.0};
  }
  double variance = block.reading_variance;
  TemperatureInnovation found = filter.temperature_innovation(block.reading, variance, block.leaked_time);
  const double squared = square(found.innovation) / found.variance;
  const double spread = std::log(found.variance);
  if (is_surprising(found) && !zeros) {
    const double rate = std::min(std::abs(found.innovation) / block.interval, array_.priors.fastest);
    filter.admit(maneuver(*filter.belief(), block.interval).data(), square(rate));
    found = filter.temperature_innovation(block.reading, variance, block.leaked_time);
  }
  const bool early = block.leaked_time < kEarly && !block.touched.any();
  if (is_surprising(found) && zeros && observable_ && early) {
    std::array<double, kSharedStates> earlier{};
    earlier[kEarlier] = 1.0;
    earlier[kZero] = -0.5 * block.leaked_time;  // half of what was missed until now has counted as an error of the zero
    filter.admit(earlier.data(),
                 square(std::min(2.0 * std::abs(found.innovation) / block.leaked_time, array_.priors.rate)));
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

bool Propagation::is_misled(const LastBlocks& blocks, const Belief& belief) {
  if (blocks.size() == 0) {
    return false;
  }
  const Belief& before = blocks[0].before;
  const double change = belief.shared[kRate] - before.shared[kRate];
  const double noise = dynamics_.transition(before.shared, blocks.newest().span).noise[kRate * kSharedStates + kRate];
  const double variance = before.variance(kRate) + static_cast<double>(blocks.size()) * noise;
  return change * array_.per_kelvin > 0.0 && square(change) > square(kSurprising) * variance;
}

void Propagation::admit_walk(ForceErrorFilter& filter, double walk, double known, double age) {
  if (walk > known) {
    std::array<double, kSharedStates> drifting{};
    drifting[kDrift] = 1.0;
    drifting[kRate] = -1.0 / array_.per_kelvin;
    drifting[kChip] = drifting[kFilm] = drifting[kSensor] = age * drifting[kRate];
    const double observed = std::min(age, TemperatureWalk::kMemory * TemperatureWalk::kLeastTime);
    filter.widen(drifting.data(), square(array_.per_kelvin / age) * (walk - known) * observed);
  }
  dynamics_.set_film_walk(walk);
}

double Propagation::film_rate(const Belief& belief) const {
  const std::vector<double>& shared = belief.shared;
  return array_.film_lag > 0.0 ? (shared[kChip] - shared[kFilm]) / array_.film_lag : shared[kRate];
}

double tail_spread(const ErrorPriors& priors, const Belief& belief) {
  return std::max(priors.tail, std::abs(belief.shared[kTail]));
}

}  // namespace posfet
