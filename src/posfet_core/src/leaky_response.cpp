// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/leaky_response.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace posfet {

namespace {

/// What a step keeps of a charge, and what it leaves of the change of a source.
struct Step {
  double kept;
  double left;
};

Step step_to(const double* time, double time_constant) {
  const double ratio = (time[0] - time[-1]) / time_constant;
  const double lost = -std::expm1(-ratio);
  return {1.0 - lost, lost / std::max(ratio, 1e-300)};
}

/// Columns of a fit in one scan after another.
class FitColumns {
public:
  FitColumns(const Course& course, const LeakyCharge& charge)
      : course_(course), charge_(charge), leaking_(course.columns, 0.0), row_(course.columns + 2, 0.0) {
    take(0, Step{0.0, 0.0});
  }

  /// The row of the next scan.
  void take(std::size_t scan) { take(scan, step_to(course_.time + scan, charge_.time_constant)); }

  const std::vector<double>& row() const { return row_; }

private:
  void take(std::size_t scan, const Step& step) {
    const std::size_t columns = course_.columns;
    const double* const now = course_.source + scan * columns;
    const double* const before = scan > 0 ? now - columns : now;
    const double decay = std::exp(-(course_.time[scan] - course_.time[0]) / charge_.time_constant);
    double value = 0.0;
    for (std::size_t column = 0; column < columns; ++column) {
      leaking_[column] = step.kept * leaking_[column] + step.left * (now[column] - before[column]);
      const bool has_leaked = column >= charge_.first_signal && column < charge_.end_of_signals;
      row_[column] = has_leaked ? now[column] : leaking_[column];
      value += charge_.coefficients[column] * row_[column];
    }
    value += charge_.start * decay;
    if (scan == 0) {
      first_ = before_ = value;
    }
    fast_ = step.kept * fast_ + step.left * (value - before_);
    before_ = value;
    const double slow = value - first_ - fast_ + first_ * (1.0 - decay);
    row_[columns] = -charge_.time_constant * slow;
    row_[columns + 1] = decay;
  }

  Course course_;
  LeakyCharge charge_;
  std::vector<double> leaking_;
  std::vector<double> row_;
  double first_ = 0.0;
  double before_ = 0.0;
  double fast_ = 0.0;
};

}  // namespace

void high_pass(const Course& course, double time_constant, double* response) {
  const std::size_t columns = course.columns;
  std::fill_n(response, columns, 0.0);
  for (std::size_t scan = 1; scan < course.scans; ++scan, response += columns) {
    const Step step = step_to(course.time + scan, time_constant);
    const double* const now = course.source + scan * columns;
    for (std::size_t column = 0; column < columns; ++column) {
      const double change = now[column] - now[column - columns];
      response[columns + column] = step.kept * response[column] + step.left * change;
    }
  }
}

void low_pass(const Course& course, double time_constant, double* response) {
  const std::size_t columns = course.columns;
  const double* const first = course.source;
  high_pass(course, time_constant, response);
  const bool balanced = std::all_of(first, first + columns, [](double value) { return value == 0.0; });
  for (std::size_t scan = 0; scan < course.scans; ++scan, response += columns) {
    const double* const now = first + scan * columns;
    const double risen = balanced ? 0.0 : -std::expm1(-(course.time[scan] - course.time[0]) / time_constant);
    for (std::size_t column = 0; column < columns; ++column) {
      response[column] = now[column] - first[column] - response[column] + first[column] * risen;
    }
  }
}

void play_distance(const double* force, std::size_t scans, std::size_t columns, double half_width, double* distance) {
  std::vector<double> play(columns, 0.0);
  for (std::size_t scan = 0; scan < scans; ++scan, force += columns, distance += columns) {
    for (std::size_t column = 0; column < columns; ++column) {
      play[column] = std::min(std::max(play[column], force[column] - half_width), force[column] + half_width);
      distance[column] = force[column] - play[column];
    }
  }
}

void fit_columns(const Course& course, const LeakyCharge& charge, std::size_t block, double* means) {
  FitColumns columns(course, charge);
  const std::size_t width = course.columns + 2;
  const auto scans_of_block = static_cast<double>(block);
  for (std::size_t begin = 0; begin + block <= course.scans; begin += block, means += width) {
    std::fill_n(means, width, 0.0);
    for (std::size_t scan = begin; scan < begin + block; ++scan) {
      if (scan > 0) {
        columns.take(scan);
      }
      std::transform(means, means + width, columns.row().begin(), means, [](double a, double b) { return a + b; });
    }
    std::transform(means, means + width, means, [scans_of_block](double total) { return total / scans_of_block; });
  }
}

}  // namespace posfet
