// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Course of the forces that are held, in the stored blocks.
#pragma once

#include <cstddef>

#include "posfet_core/estimation/belief.hpp"
#include "posfet_core/estimation/block.hpp"
#include "posfet_core/flags.hpp"
#include "posfet_core/grid.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

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

/// Taxels that have been in contact in all stored blocks, of those that count.
Taxels held_taxels(const LastBlocks& blocks, const TaxelFlags& counts);

/// What some taxels did in the stored blocks, as the belief has their errors.
SteadyWindow window_of(const LastBlocks& blocks, const Belief& belief, const Taxels& held);

/// Take the mean from some values.
void subtract_mean(Vector<double>& values);

}  // namespace posfet
