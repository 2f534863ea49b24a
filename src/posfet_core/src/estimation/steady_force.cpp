// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/steady_force.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "force_estimator_constants.hpp"
#include "posfet_core/estimation/shared_states.hpp"
#include "posfet_core/numbers.hpp"
#include "posfet_core/product.hpp"

namespace posfet {

namespace {

/// Mean square residual above which a force is not steady, in variances of its points [1].
constexpr double kMisfit = 2.0;

/// Residual of a steady force beyond that, as a share of the change of the charge [1].
constexpr double kModelError = 2e-3;

/// Relative change of a steady force in a window [1]: a larger one may be nonlinear, too.
constexpr double kLargestChange = 0.015;

/// Part of the change of a force within a window that looks like a decay of the charge in another one [1]: that of a
/// tremor of 1.2 Hz; less for any slower one.
constexpr double kTremor = 0.1;

/// Windows in which a force that was less steady is forgotten [1]: about two thirds of a second.
constexpr double kUnsteadyWindows = 8.0;

/// Standard deviation of b above which a window is not informative [1].
constexpr double kInformative = 0.03;

double product(const Vector<double>& one, const Vector<double>& other) {
  return dot(one.data(), other.data(), one.size());
}

/// Take the mean from some values.
void subtract_mean(Vector<double>& values) {
  const double mean = sum(values) / static_cast<double>(values.size());
  for (double& each : values) {
    each -= mean;
  }
}

/// Take mean and linear trend, of these weights in its slope, from a course of values.
Vector<double> without_trend(Vector<double> values, const Vector<double>& weights) {
  subtract_mean(values);
  const double factor = product(weights, values) / product(weights, weights);
  for (std::size_t point = 0; point < values.size(); ++point) {
    values[point] -= weights[point] * factor;
  }
  return values;
}

/// Change of each taxel's force but for what the charge explains, per time [N/s].
Vector<double> motion(const SteadyWindow& window, double slope) {
  Vector<double> rate;
  for (std::size_t taxel = 0; taxel < window.force_rate.size(); ++taxel) {
    rate.push_back(window.force_rate[taxel] - slope * window.charge_rate[taxel]);
  }
  return rate;
}

/// Taxels that have been in contact in all stored blocks, of those that count.
Taxels held_taxels(const LastBlocks& blocks, const TaxelFlags& counts) {
  Taxels held;
  for (std::size_t taxel = 0; taxel < counts.size(); ++taxel) {
    bool steady = counts[taxel];
    for (std::size_t index = 0; steady && index < blocks.size(); ++index) {
      steady = blocks[index].listed[taxel];
    }
    if (steady) {
      held.push_back(static_cast<Taxel>(taxel));
    }
  }
  return held;
}

/// What some taxels did in the stored blocks, as the belief has their errors.
SteadyWindow window_of(const LastBlocks& blocks, const Belief& belief, const Taxels& held) {
  SteadyWindow window(blocks.times(), held.size());
  for (std::size_t index = 0; index < blocks.size(); ++index) {
    const Block& block = blocks[index];
    for (std::size_t place = 0; place < held.size(); ++place) {
      const auto taxel = static_cast<std::size_t>(held[place]);
      std::array<double, kSharedStates> response{};
      std::copy_n(block.response.data() + taxel * kSharedStates, response.size(), response.begin());
      response[kLeak] = -block.charge[taxel];  // as it is, whatever its time constant
      const double expected =
          belief.error_of(taxel)[kForceError] + dot(response.data(), belief.shared.data(), response.size());
      window.add(index, place, block.mean[taxel] - expected, block.charge[taxel]);
      response[kFilm] = 0.0;  // the only one of these states that is not constant
      for (std::size_t shared = 0; shared < kSharedStates; ++shared) {
        window.response[shared][index] += response[shared];
      }
    }
  }
  return window;
}

}  // namespace

SteadyWindow::SteadyWindow(Vector<double> times, std::size_t taxels)
    : time(std::move(times)),
      weights(time),
      force(time.size(), 0.0),
      charge(time.size(), 0.0),
      force_rate(taxels, 0.0),
      charge_rate(taxels, 0.0),
      response(kSharedStates, Vector<double>(time.size(), 0.0)) {
  subtract_mean(weights);
  const double square = product(weights, weights);
  for (double& each : weights) {
    each /= square;
  }
}

void SteadyWindow::add(std::size_t block, std::size_t taxel, double its_force, double its_charge) {
  force[block] += its_force;
  charge[block] += its_charge;
  force_rate[taxel] += weights[block] * its_force;
  charge_rate[taxel] += weights[block] * its_charge;
}

bool SteadyForce::is_due(bool possible) {
  ++passed_;
  const bool due = possible && passed_ >= kHop;
  passed_ = due ? 0 : passed_;
  return due;
}

std::optional<SharedMeasurement> SteadyForce::observe(const SteadyWindow& window, double warmed, double noise) {
  const auto points = static_cast<double>(window.time.size());
  const double total = sum(window.force) / points;
  if (warmed > kLargestChange * total) {
    return std::nullopt;
  }
  const Vector<double> decay = without_trend(window.charge, window.weights);
  const double square = product(decay, decay) - (points - 2.0) * noise;
  if (square * kInformative * kInformative <= noise) {
    return std::nullopt;
  }
  const Vector<double> course = without_trend(window.force, window.weights);
  const double slope = (product(decay, course) - (points - 2.0) * noise) / square;
  double residual = 0.0;
  for (std::size_t point = 0; point < course.size(); ++point) {
    const double each = course[point] - slope * decay[point];
    residual += each * each;
  }
  residual /= points - 3.0;
  // Also of each taxel: an object that slides keeps its force, but not the forces of the taxels.
  const double duration = window.time.back() - window.time.front();
  const Vector<double> rate = motion(window, slope);
  const double moved = duration * std::accumulate(rate.begin(), rate.end(), 0.0,
                                                  [](double all, double each) { return all + std::abs(each); });
  const double expected = kMisfit * noise * (1.0 - slope) * (1.0 - slope);
  if (residual > expected + kModelError * kModelError / points * square || moved > kLargestChange * total) {
    return std::nullopt;
  }
  // A tremor changes the force in one window, by more than two deviations of its noise, and bends its course in the
  // next one.
  const double noisy = 4.0 * noise * (1.0 - slope) * (1.0 - slope) * product(window.weights, window.weights);
  const double changed = std::sqrt(std::max(sum(rate) * sum(rate) - noisy, 0.0)) * duration;
  unsteadiness_ = std::max(unsteadiness_ * (1.0 - 1.0 / kUnsteadyWindows), changed / total);
  const double bent = kTremor * unsteadiness_ * total;
  // Windows overlap: each counts for its new blocks only.
  const double variance = kSteadiness * kSteadiness + (noise + points * bent * bent) / square;
  SharedMeasurement found{slope, {}, points / kHop * variance};
  for (const Vector<double>& response : window.response) {
    found.sensitivity.push_back(product(decay, without_trend(response, window.weights)) / square);
  }
  return found;
}

void SteadyForce::update(ForceErrorFilter& filter, const LastBlocks& blocks, const TaxelFlags& counts,
                         const std::vector<double>& newton_per_kelvin) {
  const Taxels held = held_taxels(blocks, counts);
  if (held.empty()) {
    return;
  }
  const Belief& b = *filter.belief();
  const SteadyWindow window = window_of(blocks, b, held);
  double coldest = std::numeric_limits<double>::infinity();
  double warmest = -coldest;
  for (std::size_t index = 0; index < blocks.size(); ++index) {
    coldest = std::min(coldest, blocks[index].before.shared[kFilm]);
    warmest = std::max(warmest, blocks[index].before.shared[kFilm]);
  }
  double response = 0.0;
  double noise = 0.0;
  for (const Taxel each : held) {
    response += newton_per_kelvin[static_cast<std::size_t>(each)];
    noise += blocks.newest().noise[static_cast<std::size_t>(each)];
  }
  const double changed = std::sqrt(b.variance(kRate)) * (window.time.back() - window.time.front());
  const auto found = observe(window, std::abs(response) * (warmest - coldest + changed), noise);
  if (!found) {
    return;
  }
  const double expected = filter.shared_variance(found->sensitivity.data()) + found->variance;
  if (square(found->innovation) < square(kSurprising) * expected) {
    filter.measure_shared(found->innovation, found->sensitivity.data(), found->variance);
  }
}

}  // namespace posfet
