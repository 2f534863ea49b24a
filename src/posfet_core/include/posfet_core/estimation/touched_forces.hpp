// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Forces of a touch, as far as what it leaves in the signals depends on them.
#pragma once

#include <vector>

#include "posfet_core/estimation/belief.hpp"
#include "posfet_core/estimation/block.hpp"
#include "posfet_core/estimation/contact_surroundings.hpp"
#include "posfet_core/estimation/estimated_array.hpp"
#include "posfet_core/estimation/held_forces.hpp"
#include "posfet_core/estimation/thermal_contact.hpp"
#include "posfet_core/estimation/touch_response.hpp"
#include "posfet_core/flags.hpp"
#include "posfet_core/grid.hpp"

namespace posfet {

/// Knows how much presses each taxel, without noise, what those beside a touch feel, and between which bounds a force
/// is where warmth hides some of it.
class TouchedForces {
public:
  /// What a block shows; arrays have one value for each taxel.
  struct Shown {
    const Belief& belief;             ///< Before the block.
    const TouchResponse& touch;       ///< Before the block.
    const std::vector<double>& mean;  ///< Mean force [N].
    const TaxelFlags& ignored;        ///< Faulty taxels.
    const TaxelFlags& informative;    ///< Those of them that count in sums.
  };

  TouchedForces(const EstimatedArray& array, const ContactSurroundings& surroundings);

  /// Follow the forces of a block; finds what its touch lets the taxels beside it feel.
  void follow(Block& block, const Shown& shown);

  /// Force that follows the mean with a play [N]: noise is no motion.
  const std::vector<double>& steady() const { return steady_; }

  /// Force of each taxel in contact [N], 0 elsewhere, and what it is at least and at most [N].
  const std::vector<double>& pressing() const { return pressing_; }
  const std::vector<double>& least() const { return least_; }
  const std::vector<double>& most() const { return most_; }

  /// What the readings show of the thermal contact; nothing where warmth hides less than a force.
  const ThermalContact& thermal_contact() const { return thermal_contact_; }

  /// What warmth hides of a force, over the force that causes most of that warmth [1].
  double hidden_share(const Belief& belief) const;

  /// Find the taxels of contacts that were left, as their film cools; returns whether there are any. Once per block.
  bool find_left(const Vector<const Taxels*>& contacts, TaxelFlags& left) {
    return thermal_contact_.find_left(contacts, left);
  }

  /// Forget what the thermal contact has shown: the touch is another one.
  void forget_contact() { thermal_contact_.reset(); }

private:
  void find_tails(Block& block, const TaxelFlags& ignored);
  void find_bounds(const Block& block, const Shown& shown);
  void raise_to_held(const Shown& shown, const TaxelFlags& near, double duration);
  void follow_thermal_contact(const Shown& shown, double duration);

  const EstimatedArray& array_;
  const ContactSurroundings& surroundings_;
  HeldForces held_;
  ThermalContact thermal_contact_;
  std::vector<double> steady_;
  std::vector<double> felt_;  ///< Size of the steady force [N]; of a faulty taxel what it may be.
  std::vector<double> pressing_;
  std::vector<double> least_;
  std::vector<double> most_;
  std::vector<double> known_;    ///< Force in contact of the taxels that are not faulty [N].
  std::vector<double> reading_;  ///< What taxels read but for their warmth [N].
};

}  // namespace posfet
