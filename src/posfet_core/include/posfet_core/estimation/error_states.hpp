// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// How the states that all taxels share change, and how well they are known.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "posfet_core/estimation/shared_states.hpp"
#include "posfet_core/estimation/small_matrix.hpp"

namespace posfet {

/// Sizes of the loops of the film's hysteresis.
constexpr std::size_t kLoops = 3;

/// Time constants with which an object warms the chip.
constexpr std::size_t kWarmings = 3;

/// Standard deviations of the force errors; `ErrorPriors` in posfet_model/estimation/error_states.py explains them and
/// has their defaults.
struct ErrorPriors {
  double film_walk;
  double rate;
  double rate_walk;
  double rate_change;
  double slow_rate;
  double touch_rate;
  double warming_share;
  std::array<double, kWarmings> chip_times;
  std::array<double, kWarmings> chip_warming;
  double fastest;
  double lag;
  double lag_spread;
  double dead_share;
  double scale;
  double reading;
  std::array<double, kBends> bend_mean;
  std::array<double, kBends> bend;
  std::vector<double> bend_profile;  ///< Part of each taxel in the first of them [1]; empty: all the same.
  double leak;
  double tail;
  double tail_spread;
  double tail_least;
  double tail_change;
  double warmth_mean;
  double warmth;
  double warmth_least;
  double warmth_spread;
  double warmth_force;
  double warmth_steepness;
  double warmth_force_spread;
  double warmth_certain;
  double warmth_contact;
  double warmth_time;
  std::array<double, kCreeps> creep_times;
  std::array<double, kCreeps> creep_mean;
  std::array<double, kCreeps> creep;
  std::array<double, kLoops> loop_half_widths;
  std::array<double, kLoops> loop_weights;
  double loop_slope;
  double pyroelectric;
  double earlier;
  double drift;
  double offset_walk;
  double motion;

  /// Shared states at the start, [states].
  std::vector<double> mean() const;

  /// Their covariance, [states, states].
  SquareMatrix covariance() const;
};

/// Shared states after a block.
struct SharedTransition {
  std::vector<double> after;  ///< Next state, [states].
  SquareMatrix matrix;        ///< Transition matrix, [states, states].
  SquareMatrix noise;         ///< Covariance of the process noise, [states, states].
};

/// Transition of the shared states over a block.
///
/// Chip, film and sensors: C' = U, Theta' = (C - Theta)/tau_film, S' = (C - S)/exp(l); the others are constant,
/// but for a small random walk by which they forget in about an hour; drift, earlier warming, zero and tail have none.
/// How the sensors follow a change of the rate is not quite
/// known where a part of their lag is a dead time.
class SharedDynamics {
public:
  /// Time in which a constant state becomes uncertain again [s].
  static constexpr double kForget = 3600.0;

  /// Least logarithm of the time constant of the sensors' lag that makes a difference [1]: 0.9 ms.
  static constexpr double kLeastLag = -7.0;

  /// Greatest one [1]: 20 s.
  static constexpr double kGreatestLag = 3.0;

  /// The priors, which stay where they are; time constant of the film's lag behind the chip [s], >= 0.
  SharedDynamics(const ErrorPriors& priors, double film_lag);

  /// Set the variance by which the temperature of chip and film grows in each second [K2/s].
  void set_film_walk(double intensity);

  /// The transition from a state, [states], over a block [s], in which the chip warms at a rate beyond that of the
  /// state [K/s]; overwritten by the next call.
  SharedTransition& transition(const std::vector<double>& state, double duration, double warming = 0.0);

  /// How the shared states change if the rate of the chip temperature changed by 1 K/s some time [s] ago, [states];
  /// overwritten by the next call.
  const std::vector<double>& maneuver(const std::vector<double>& state, double duration);

  /// Time constant of the sensors' lag [s], within what a sensor can have.
  static double sensor_lag(const std::vector<double>& state);

private:
  const ErrorPriors& priors_;
  double film_lag_;
  SquareMatrix noise_;  ///< Of the process, in each second.
  SharedTransition transition_;
  std::vector<double> maneuver_;
};

}  // namespace posfet
