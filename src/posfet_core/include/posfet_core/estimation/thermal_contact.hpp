// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What the readings of taxels show of the thermal contact, where warmth hides forces.
#pragma once

#include <cstddef>
#include <vector>

#include "posfet_core/estimation/blocks_in_a_row.hpp"
#include "posfet_core/flags.hpp"
#include "posfet_core/grid.hpp"
#include "posfet_core/numbers.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

/// Finds which taxels something warms, and which contacts have been left.
///
/// A taxel whose film is warm reads less than its force, and its warmth follows the thermal contact with a known time
/// constant. So its reading tends to a value: the force less all that its thermal contact hides. No force is below
/// zero, so that a reading that stays below it is warmed by something; but that of a film that was left cools to zero.
/// Neither depends on how warm the film is believed to be.
class ThermalContact {
public:
  /// Blocks over which readings are compared [1]: 0.1 s.
  static constexpr std::size_t kBlocks = 5;

  /// Share of a reading below zero that it must tend to, at least, to be warmed [1].
  static constexpr double kWarmed = 0.5;

  /// Share of the lowest reading of a contact within which all its taxels tend to zero once it was left [1]: the time
  /// constant is known to about a tenth.
  static constexpr double kLeft = 0.25;

  /// Time constant with which the film warms and cools [s]; reading below which one is below zero beyond errors [N].
  ThermalContact(std::size_t taxels, double warmth_time, double threshold);

  std::size_t taxels() const { return tends_.size(); }

  /// Forget all readings.
  void reset();

  /// Process a block of `duration` [s]: what taxels read but for their warmth [N].
  void update(const std::vector<double>& reading, double duration);

  /// Value that the reading of a taxel tends to [N]; NaN: unknown yet.
  double tends_to(std::size_t taxel) const { return known() ? tends_[taxel] : kUnknown; }

  /// Whether a contact reads less than none, and all of it tends to none.
  bool cools(const Taxels& contact) const;

  /// Whether something warms a taxel.
  bool warmed(std::size_t taxel) const;

  /// Find the taxels of contacts that were left; returns whether there are any. Once per block.
  bool find_left(const Vector<const Taxels*>& contacts, TaxelFlags& left);

private:
  bool known() const { return seen_ >= readings_.size(); }
  const std::vector<double>& newest() const { return readings_[(seen_ - 1) % readings_.size()]; }

  double warmth_time_;
  double threshold_;
  std::size_t seen_ = 0;
  std::vector<std::vector<double>> readings_;  ///< Of the last blocks, the oldest one replaced by the next [N].
  std::vector<double> tends_;                  ///< Value that each reading tends to [N].
  BlocksInARow cools_for_;
};

}  // namespace posfet
