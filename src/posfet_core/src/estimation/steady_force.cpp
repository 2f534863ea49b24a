// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/steady_force.hpp"

#include <cmath>
#include <utility>

#include "posfet_core/estimation/small_matrix.hpp"
#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// Mean square residual above which a force is not steady, in variances of its points [1].
constexpr double kMisfit = 2.0;

/// Residual of a steady force beyond that, as a share of the change of the charge [1].
constexpr double kModelError = 2e-3;

/// Relative change of a steady force in a window [1]: a larger one may be nonlinear, too.
constexpr double kLargestChange = 0.015;

/// Standard deviation of b above which a window is not informative [1].
constexpr double kInformative = 0.03;

double product(const Vector<double>& one, const Vector<double>& other) {
  return dot(one.data(), other.data(), one.size());
}

Vector<double> sums(const Vector<Vector<double>>& rows) {
  Vector<double> found;
  found.reserve(rows.size());
  for (const auto& row : rows) {
    found.push_back(sum(row));
  }
  return found;
}

/// Takes mean and linear trend from a course of values.
class Trend {
public:
  explicit Trend(Vector<double> time) : before_(std::move(time)) {
    subtract_mean(before_);
    rate_ = before_;
    const double square = product(before_, before_);
    for (double& each : rate_) {
      each /= square;
    }
  }

  /// Weights of the values in their slope [1/s].
  const Vector<double>& rate() const { return rate_; }

  Vector<double> removed(Vector<double> values) const {
    subtract_mean(values);
    const double slope = product(rate_, values);
    for (std::size_t point = 0; point < values.size(); ++point) {
      values[point] -= before_[point] * slope;
    }
    return values;
  }

private:
  static void subtract_mean(Vector<double>& values) {
    const double mean = sum(values) / static_cast<double>(values.size());
    for (double& each : values) {
      each -= mean;
    }
  }

  Vector<double> before_;
  Vector<double> rate_;
};

/// Change of each taxel's force but for what the charge explains, all together, per time [N/s].
double motion(const SteadyWindow& window, const Vector<double>& rate, double slope) {
  double total = 0.0;
  for (std::size_t taxel = 0; taxel < window.force.front().size(); ++taxel) {
    double each = 0.0;
    for (std::size_t point = 0; point < rate.size(); ++point) {
      each += rate[point] * (window.force[point][taxel] - slope * window.charge[point][taxel]);
    }
    total += std::abs(each);
  }
  return total;
}

}  // namespace

std::optional<SharedMeasurement> steady_force(const SteadyWindow& window, double warmed, double noise) {
  const auto points = static_cast<double>(window.time.size());
  Vector<double> force = sums(window.force);
  const double total = sum(force) / points;
  if (warmed > kLargestChange * total) {
    return std::nullopt;
  }
  const Trend trend(window.time);
  const Vector<double> decay = trend.removed(sums(window.charge));
  const double square = product(decay, decay) - (points - 2.0) * noise;
  if (square * kInformative * kInformative <= noise) {
    return std::nullopt;
  }
  const Vector<double> course = trend.removed(std::move(force));
  const double slope = (product(decay, course) - (points - 2.0) * noise) / square;
  double residual = 0.0;
  for (std::size_t point = 0; point < course.size(); ++point) {
    const double each = course[point] - slope * decay[point];
    residual += each * each;
  }
  residual /= points - 3.0;
  // Also of each taxel: an object that slides keeps its force, but not the forces of the taxels.
  const double moved = motion(window, trend.rate(), slope) * (window.time.back() - window.time.front());
  const double expected = kMisfit * noise * (1.0 - slope) * (1.0 - slope);
  if (residual > expected + kModelError * kModelError / points * square || moved > kLargestChange * total) {
    return std::nullopt;
  }
  // Windows overlap: each counts for its new blocks only.
  SharedMeasurement found{slope, {}, points / kHop * (noise / square + kSteadiness * kSteadiness)};
  for (const Vector<double>& response : window.response) {
    found.sensitivity.push_back(product(decay, trend.removed(response)) / square);
  }
  return found;
}

}  // namespace posfet
