// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/signal_steps.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "force_estimator_constants.hpp"
#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// Part by which the change of slope may differ from that which a step makes [1].
constexpr double kMatch = 0.5;

constexpr auto kCount = static_cast<double>(kStepHalf);

/// Times of one half of a window, about its middle [s].
struct Half {
  std::size_t first;                      ///< Index of its first block.
  double mean;                            ///< Their mean.
  std::array<double, kStepHalf> centred;  ///< Times about it.
  double square;                          ///< Sum of their squares [s2].
};

Half half_of(const Vector<double>& time, std::size_t first) {
  Half half{first, 0.0, {}, 0.0};
  for (std::size_t block = 0; block < kStepHalf; ++block) {
    half.mean += (time[first + block] - time[kStepHalf]) / kCount;
  }
  for (std::size_t block = 0; block < kStepHalf; ++block) {
    half.centred[block] = time[first + block] - time[kStepHalf] - half.mean;
    half.square += square(half.centred[block]);
  }
  return half;
}

struct Line {
  double value = 0.0;     ///< At the middle of the window [N].
  double slope = 0.0;     ///< [N/s].
  double residual = 0.0;  ///< Sum of squares [N2].
};

Line fit(const Half& half, const Vector<const double*>& force, std::size_t taxel) {
  double mean = 0.0;
  double slope = 0.0;
  for (std::size_t block = 0; block < kStepHalf; ++block) {
    mean += force[half.first + block][taxel] / kCount;
    slope += half.centred[block] * force[half.first + block][taxel];
  }
  slope /= half.square;
  Line line{mean - slope * half.mean, slope, 0.0};
  for (std::size_t block = 0; block < kStepHalf; ++block) {
    line.residual += square(force[half.first + block][taxel] - mean - slope * half.centred[block]);
  }
  return line;
}

}  // namespace

void find_signal_steps(const StepWindow& window, const std::vector<double>& time_constant, double* step) {
  const std::size_t taxels = time_constant.size();
  std::fill_n(step, taxels, 0.0);
  const Half before = half_of(window.time, 0);
  const Half after = half_of(window.time, kStepHalf + 1);
  const double of_slope = 1.0 / before.square + 1.0 / after.square;
  const double of_jump = 2.0 / kCount + square(before.mean) / before.square + square(after.mean) / after.square;
  std::size_t jumps = 0;
  for (std::size_t taxel = 0; taxel < taxels; ++taxel) {
    if (!window.where[taxel]) {
      continue;
    }
    const Line first = fit(before, window.force, taxel);
    const Line second = fit(after, window.force, taxel);
    const double noise = std::max(window.noise[taxel], (first.residual + second.residual) / (2.0 * kCount - 4.0));
    const double jump = second.value - first.value;
    if (square(jump) <= square(kStep) * of_jump * noise) {
      continue;
    }
    if (++jumps > 1) {
      std::fill_n(step, taxels, 0.0);
      return;
    }
    const double expected = jump / time_constant[taxel];
    const bool matches = std::abs(second.slope - first.slope - expected) < kMatch * std::abs(expected);
    if (matches && square(expected) > square(kSurprising) * of_slope * noise) {
      step[taxel] = jump;
    }
  }
}

}  // namespace posfet
