// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What the force estimator knows of an array from the start.
#pragma once

#include <cstddef>
#include <vector>

#include "posfet_core/estimation/error_states.hpp"
#include "posfet_core/force_integration.hpp"
#include "posfet_core/grid.hpp"

namespace posfet {

/// What description and calibration say of an array; vectors have one value for each taxel.
struct GivenArray {
  std::size_t taxels() const { return time_constant.size(); }

  Layout layout;
  std::vector<double> time_constant;      ///< Of the leakage [s].
  std::vector<double> newton_per_charge;  ///< Force per charge density [N m2/C].
  std::vector<double> newton_per_kelvin;  ///< Pyroelectric signal [N/K].
  std::vector<double> gain_deviation;     ///< Relative standard deviation of the gain [1],
  double common_gain_deviation;           ///< and of what all taxels have in common [1].
  std::vector<double> leak_deviation;     ///< Relative standard deviation of the leak rate [1].
  LeakTemperature leak_temperature;       ///< How it depends on the temperature.
  double noise;                           ///< Standard deviation of a reading [N].
  double threshold;                       ///< Contact threshold [N].
  double greatest_force;                  ///< Greatest force of a taxel [N].
  double left_charge;                     ///< Charge left by an earlier force at the start, as a force [N].
  double film_lag;                        ///< Time constant of the film's lag behind the chip [s], >= 0.
  ErrorPriors priors;
};

/// An array with what follows from that: `bend_profile` has a part of each taxel, and a pyroelectric signal that would
/// not matter is none. The estimator has the only one, which its parts refer to.
struct EstimatedArray : GivenArray {
  /// Throws std::invalid_argument where the array is none, or values are missing.
  explicit EstimatedArray(GivenArray given);

  double per_kelvin = 0.0;  ///< Mean of `newton_per_kelvin` [N/K].
  std::vector<double> x;    ///< Position, from -1 to 1 at the edges of the array.
  std::vector<double> y;
};

}  // namespace posfet
