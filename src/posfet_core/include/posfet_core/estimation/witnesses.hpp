// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What the temperature sensors alone say since some seconds ago.
#pragma once

#include <cstddef>
#include <vector>

#include "posfet_core/estimation/belief.hpp"
#include "posfet_core/estimation/block.hpp"
#include "posfet_core/estimation/force_error_filter.hpp"
#include "posfet_core/estimation/propagation.hpp"
#include "posfet_core/estimation/touch_response.hpp"

namespace posfet {

/// A belief of some time ago, and the shared states that follow from it by the temperature sensors alone.
struct Witness {
  explicit Witness(std::size_t taxels);

  Belief before;               ///< What was known then.
  ForceErrorFilter filter;     ///< Of the shared states since then; no taxels.
  double age = 0.0;            ///< How long ago that was [s].
  double evidence = 0.0;       ///< Twice the logarithm of how much likelier readings are without zeros than with [1].
  std::size_t first = 0;       ///< First of the passages since then.
  std::size_t next = 0;        ///< The one that the shared states have to follow next.
  std::vector<double> noise;   ///< Process noise of the taxels until then, as in `Witnesses`, [taxels, own, own],
  std::vector<double> cooled;  ///< and the logarithm of the share of their warmth that was left [1].
};

/// Witnesses of the last seconds, oldest first. What passes between two readings of the sensors is a passage; of
/// readings that follow each other faster, those in between are left out. In each block one witness follows one
/// passage.
class Witnesses {
public:
  /// Time between two witnesses [s], assumed.
  static constexpr double kSpacing = 2.0;

  /// Number of witnesses: the oldest one is of ten seconds ago.
  static constexpr std::size_t kCount = 5;

  /// Least duration of a passage [s]: no less than there are witnesses, in blocks.
  static constexpr double kPassage = 0.09;

  Witnesses(std::size_t taxels, const TouchResponse& touch);

  /// Forget all.
  void clear();

  /// Record a block, and let a witness follow. Where a reading is not what the sensors alone let expect, the
  /// temperature does something of its own, and they know nothing of a press: all are forgotten.
  void follow(const Block& block, Propagation& propagation);

  /// The witness with the most evidence, if that is enough, and if zeros have hidden a press since then: they have made
  /// the film, which is at some temperature [K], warmer in the sense of its signal [N/K]. None: a null pointer.
  const Witness* best(double film, double per_kelvin) const;

  /// Call a witness of a belief, if the last one is old enough and no passage has begun.
  void call(const Belief& belief);

  /// Set a belief to what it would be had nothing been known of the forces since a witness was called: none of the
  /// taxels touched, and with equal parts of their process noise in each passage. At least one has been since.
  void replay(const Witness& witness, ForceErrorFilter& filter, Propagation& propagation);

private:
  void pass(const Block& block);
  Witness* behind();

  std::vector<Witness> witnesses_;
  std::size_t size_ = 0;
  std::vector<Passage> passages_;
  Passage begun_;               ///< The one that no reading has ended yet.
  std::vector<double> noise_;   ///< Sum of the process noise of the taxels since the start, [taxels, own, own].
  std::vector<double> cooled_;  ///< Logarithm of the share of their warmth that is left since the start [1].
  Block passed_;                ///< Place of a passage.
};

}  // namespace posfet
