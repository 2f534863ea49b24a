// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What a force that is held tells of the causes that make it seem to change.
///
/// The uncorrected force of an integration with tau' instead of the true tau is F' = (1 - b)*F + b*x, where x is the
/// charge that is left and b = 1 - tau/tau'. While a force is held, or changes at a constant rate, F' follows the decay
/// of x, which a linear trend does not explain. So the force of all touched taxels in a window of blocks is fitted by
/// a + c*t + b*x. The slope b measures all shared states with a response of that shape: leak first, and warmth and
/// creep as far as theirs is alike.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "posfet_core/estimation/belief.hpp"
#include "posfet_core/estimation/block.hpp"
#include "posfet_core/estimation/force_error_filter.hpp"
#include "posfet_core/flags.hpp"
#include "posfet_core/grid.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

/// Error of b as a force is never quite steady, whatever it seems: standard deviation [1], assumed.
constexpr double kSteadiness = 0.02;

/// What the touched taxels do in a window of blocks.
struct SteadyWindow {
  SteadyWindow(Vector<double> times, std::size_t taxels);

  /// Add the estimated force, with the present shared states, and the charge that is left, as a force up to a constant
  /// [N], of a taxel in a block.
  void add(std::size_t block, std::size_t taxel, double its_force, double its_charge);

  Vector<double> time;              ///< Times of the blocks [s].
  Vector<double> weights;           ///< Weights of the blocks in the slope of a trend [1/s].
  Vector<double> force;             ///< Sums of the forces of each block [N].
  Vector<double> charge;            ///< Sums of the charges of each block [N].
  Vector<double> force_rate;        ///< Slope of the force of each taxel [N/s].
  Vector<double> charge_rate;       ///< Slope of the charge of each taxel [N/s].
  Vector<Vector<double>> response;  ///< Response of the error of the sum of forces to each of the shared states,
                                    ///< [states][blocks]; zero for states that are not constant.
};

/// A measurement of the shared states: innovation = sensitivity.(true - estimated states) + noise.
struct SharedMeasurement {
  double innovation;           ///< Measured less expected value.
  Vector<double> sensitivity;  ///< Sensitivity to the shared states, [states].
  double variance;             ///< Variance of the noise.
};

/// Finds what forces that are held tell, and how steady they have been.
class SteadyForce {
public:
  /// Count a block; return whether a window begins with it, where one can.
  bool is_due(bool possible);

  /// Find what the touched taxels together tell in a window: none where that is nothing, or their force is not steady.
  /// `warmed`: by how much the film's temperature may have changed their sum within the window [N]; `noise`: variance
  /// of the noise of each sum of forces and of charges, which is the same noise [N2].
  std::optional<SharedMeasurement> observe(const SteadyWindow& window, double warmed, double noise);

  /// Update a belief by what the taxels that count, with pyroelectric signals [N/K], have shown in the stored blocks.
  void update(ForceErrorFilter& filter, const LastBlocks& blocks, const TaxelFlags& counts,
              const std::vector<double>& newton_per_kelvin);

private:
  std::size_t passed_ = 0;     ///< Blocks since the last window.
  double unsteadiness_ = 0.0;  ///< Greatest change of the force in a window, for a while, as a share of the force [1].
};

}  // namespace posfet
