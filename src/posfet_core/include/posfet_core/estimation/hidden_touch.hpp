// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Whether something may touch that warmth hides.
#pragma once

#include <cstddef>
#include <vector>

#include "posfet_core/estimation/estimated_array.hpp"
#include "posfet_core/estimation/thermal_contact.hpp"
#include "posfet_core/flags.hpp"
#include "posfet_core/grid.hpp"

namespace posfet {

/// Knows whether something may touch a film that hides it.
///
/// Where warmth hides more of a weak force than there is, a film that is pressed may read as much as one that nothing
/// touches, or less. So a reading that stays at zero is no evidence that a touch has ended: only a film that cools is.
/// And a reading that falls slowly, as zeros follow it, is a press.
class HiddenTouch {
public:
  /// Share of the contact threshold by which what a taxel reads differs from none [1].
  static constexpr double kReads = 0.35;

  /// Time after which warmth may hide a touch, in time constants of that warmth [1].
  static constexpr double kBrief = 0.5;

  /// Blocks in a row in which all that is touched cools if it was left [1]: more than those over which readings are
  /// compared, which an update may move together.
  static constexpr std::size_t kCooling = 6;

  explicit HiddenTouch(const EstimatedArray& array);

  /// Note that the reading of a taxel has fallen: it is pressed.
  void press(std::size_t taxel) { pressed_[taxel] = true; }

  /// Whether a taxel whose reading has fallen is pressed.
  bool presses(std::size_t taxel) const { return pressed_[taxel]; }

  /// Process the forces of a block [N], and whether the film `hides` some: a taxel whose reading has risen again is no
  /// longer pressed.
  void follow_readings(const std::vector<double>& force, bool hides);

  /// Process the touched taxels of a block of some duration [s], their forces [N], and what their readings tend to.
  void follow_touch(const TaxelFlags& touched, const std::vector<double>& force, const ThermalContact& thermal,
                    bool hides, double duration);

  /// Whether something may touch, although no force shows it.
  bool may_touch() const { return may_touch_ || pressed_.any(); }

  /// Forget all: nothing touches.
  void forget();

private:
  double least_;  ///< Least reading that differs from none [N].
  double brief_;  ///< [s].
  TaxelFlags pressed_;
  bool may_touch_ = false;
  double touched_for_ = 0.0;   ///< [s].
  std::size_t cools_for_ = 0;  ///< Blocks.
};

}  // namespace posfet
