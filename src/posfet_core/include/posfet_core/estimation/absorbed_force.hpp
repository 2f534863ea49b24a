// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What zero forces may have taken of a press that grows slowly.
#pragma once

#include <cstddef>
#include <vector>

#include "posfet_core/estimation/belief.hpp"
#include "posfet_core/estimation/block.hpp"
#include "posfet_core/estimation/estimated_array.hpp"
#include "posfet_core/flags.hpp"

namespace posfet {

/// Follows the errors of the forces and their offsets slowly, where nothing touches.
///
/// A press that grows too slowly to be seen moves both: its beginning is absorbed, and so is its growth, as an offset.
/// What the present error exceeds the followed one by may be such a press. What a film that warms makes of both is
/// known as far as the taxel's response is.
class AbsorbedForce {
public:
  /// `observable`: whether zero forces determine the temperature of the film.
  AbsorbedForce(const EstimatedArray& array, bool observable);

  /// Begin again with the present errors of a taxel.
  void restart(std::size_t taxel, const Belief& belief);

  /// Take a change of the error of a taxel's force as usual [N].
  void shift(std::size_t taxel, double change) { error_[taxel] += change; }

  /// Note that a taxel is touched, or that what it shows is unknown: what its errors become is soon usual.
  void touch(std::size_t taxel) { untouched_for_[taxel] = 0.0; }

  /// Follow the errors over a block in which the film warmed at some rate [K/s]; those of the taxels that are touched,
  /// or beside a touch, go on as they were.
  void follow(const Passage& block, const Belief& belief, double film_rate, const TaxelFlags& beside);

  /// Find what may have been absorbed of each force [N]. Taxels that are neither touched nor ignored show what the
  /// temperature of the film only seemed to be, until the sensors said otherwise, which is no press.
  void find(const Belief& belief, const TaxelFlags& touched, const TaxelFlags& ignored);

  /// What `find` found [N], >= 0.
  const std::vector<double>& values() const { return values_; }

  /// By how much each force has fallen instead [N], >= 0: what warmth may hide of a press.
  const std::vector<double>& fallen() const { return fallen_; }

  /// Set the errors of a taxel to the usual ones: what zeros have made of them since is wrong.
  void recall(std::size_t taxel, Belief& belief) const;

private:
  const EstimatedArray& array_;
  bool observable_;
  std::vector<double> error_;          ///< Usual error of each force [N],
  std::vector<double> offset_;         ///< and the offset of the signal that goes with it [N].
  std::vector<double> untouched_for_;  ///< Time since the taxel was touched [s].
  std::vector<double> values_;
  std::vector<double> fallen_;
};

}  // namespace posfet
