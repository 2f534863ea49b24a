// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What the warmth of an object may hide of its force.
#pragma once

#include <vector>

#include "posfet_core/estimation/belief.hpp"
#include "posfet_core/estimation/block.hpp"
#include "posfet_core/estimation/contact_surroundings.hpp"
#include "posfet_core/estimation/estimated_array.hpp"
#include "posfet_core/flags.hpp"

namespace posfet {

/// Follows what warmth may hide of a touch that no contact lists yet.
///
/// What a taxel reads, what zeros have absorbed and, where these two are more than errors, what is hidden already cause
/// that warmth together. It counts in the deviation only: such a touch may be none, and the filter would explain it by
/// the warmth. What a tap leaves of its force is no touch: warmth hides none of it within a block. On the taxels beside
/// it most is such a rest.
class HiddenForce {
public:
  /// What a block shows of the touch; arrays have one value for each taxel.
  struct Shown {
    const std::vector<double>& force;     ///< Mean force [N].
    const std::vector<double>& absorbed;  ///< What zeros may have taken of it [N].
    const TaxelFlags& touched;            ///< Touched taxels.
    bool begins;                          ///< Whether no contact is listed yet.
  };

  HiddenForce(const EstimatedArray& array, const ContactSurroundings& surroundings);

  /// Process a block.
  void follow(const Block& block, const Belief& belief, const Shown& shown);

  /// What may be hidden [N], >= 0.
  const std::vector<double>& values() const { return values_; }

private:
  void find_taps(const Block& block, const Shown& shown);

  const EstimatedArray& array_;
  const ContactSurroundings& surroundings_;
  double least_force_;        ///< Least force that warms a taxel as `ErrorPriors::warmth_force` says [N].
  std::vector<double> felt_;  ///< Mean force of the last block, no less than zero [N].
  TaxelFlags tapped_;         ///< Touched taxels that have lost most of their force within a block.
  std::vector<double> values_;
};

}  // namespace posfet
