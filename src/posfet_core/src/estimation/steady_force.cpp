// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/steady_force.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "posfet_core/estimation/shared_states.hpp"
#include "posfet_core/estimation/small_matrix.hpp"
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

}  // namespace

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

}  // namespace posfet
