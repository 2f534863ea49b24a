// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What the elastomer skin must let the neighbours of a pressed taxel feel;
/// posfet_model/sensor/skin_response.py says why.
#pragma once

#include "posfet_core/grid.hpp"

namespace posfet {

/// Share of what the skin must let the neighbours feel below which they contradict a touch [1]: the rest is for gains
/// and crosstalk that differ from their description.
constexpr double kClearShare = 0.5;

/// Tests whether the neighbours of taxels feel what the skin must let them feel of a touch.
class SkinResponse {
public:
  /// What the neighbours of a taxel show.
  struct Finding {
    bool contradicted = false;  ///< Along some axis the neighbours feel clearly less than they must.
    bool testable = false;      ///< There are neighbours enough along some axis.
  };

  /// `share_x` and `share_y` are the least force on a neighbour along an axis over that on the taxel [1]; NaN: along
  /// this axis nothing is tested.
  SkinResponse(const Layout& layout, double share_x, double share_y);

  const Grid& grid() const { return grid_; }

  /// Test a taxel. `force` are the forces of all taxels, or their changes, of either sign, in any unit, `variance` that
  /// of each, in that unit squared. Along an axis on which a neighbour is not `sound`, nothing is tested. `certainty`
  /// is the number of standard deviations by which the neighbours must miss what they had to feel [1]. If `one_sided` a
  /// single neighbour along an axis counts, too: for loads up to the centre of an outermost cell.
  Finding test(Taxel taxel, const double* force, const double* variance, const bool* sound, double certainty,
               bool one_sided) const;

private:
  Grid grid_;
  double share_x_;
  double share_y_;
};

}  // namespace posfet
