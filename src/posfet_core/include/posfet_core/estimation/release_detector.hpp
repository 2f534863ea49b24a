// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// When a contact has ended: its forces are zero then.
#pragma once

#include <cstddef>
#include <vector>

#include "posfet_core/estimation/block.hpp"
#include "posfet_core/estimation/blocks_in_a_row.hpp"
#include "posfet_core/grid.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

/// Finds contacts that are still listed, as their forces are above the threshold, but were released.
///
/// A contact was released when its forces are jointly within their uncertainty, small against its recent peak, and
/// still; without the last, the end of a slow release would become zero too early.
class ReleaseDetector {
public:
  /// Blocks for which a contact must look released.
  static constexpr std::size_t kReleasedBlocks = 3;

  /// A released contact has less than this share of the recent peak of its total force left [1]. Of the force of a
  /// single taxel an error may be much, after a long touch.
  static constexpr double kReleasedShare = 0.3;

  /// Deviations by which the squares of a released contact's forces may exceed their mean [1]: zero forces do so once
  /// in a thousand times. Each time a contact stays that nothing touches.
  static constexpr double kReleasedDeviations = 3.09;

  /// Share of its recent peak by which a released contact may still move [1]: the film creeps back.
  static constexpr double kResidualMotion = 0.01;

  /// Decay of the recent peak in `kBlock` [1]: 20 s.
  static constexpr double kPeakDecay = 0.999;

  /// Share of its force by which the signal of a contact has risen in the last blocks at least if it has just come [1]:
  /// what a released one leaves rises slowly.
  static constexpr double kRisenShare = 0.9;

  explicit ReleaseDetector(std::size_t taxels);

  std::size_t taxels() const { return peak_.size(); }

  /// Process a block: the taxels of each contact, mean forces [N], the same with the charge of bending, which moves as
  /// the forces do: as the bending becomes known, it would hide that they move [N]; by how much the signals rose in the
  /// last `kStillBlocks`, whatever was corrected since [N]; touched taxels, the variances of the forces [N2], those of
  /// the noise of a mean [N2], and the duration of the block [s]. The taxels of released contacts are marked; returns
  /// whether there are any.
  bool update(const Vector<const Taxels*>& contacts, const double* mean, const double* course, const double* rise,
              const bool* touched, const double* variance, const double* noise, double duration, bool* released);

  /// Whether nothing touches a taxel that was touched, and is in no contact: its force has hardly changed in the last
  /// blocks, against the standard deviation of a mean [N] and its recent peak, or the `mean` of the block that comes
  /// next [N] is below zero, as no object pulls.
  bool has_left(std::size_t taxel, double mean, double noise) const;

  /// Forget the last blocks: an unknown time has passed since.
  void restart() { seen_ = 0; }

private:
  void follow(const Taxels& contact, const double* mean, const double* rise);

  bool has_just_come(const Taxels& contact, double total, const double* rise) const;

  bool looks_released(const Taxels& contact, const double* mean, const double* course, const double* variance,
                      const double* noise) const;

  std::vector<double> peak_;                ///< Recent peak force of each taxel [N].
  std::vector<double> object_;              ///< Recent peak of the total force of the contact that it was in [N].
  std::vector<std::vector<double>> means_;  ///< Means of the last blocks with the charge of bending, in turn [N].
  std::size_t seen_ = 0;                    ///< Number of blocks.
  std::vector<std::size_t> touched_for_;    ///< Number of blocks for which a taxel has been touched.
  BlocksInARow looks_released_for_;
};

}  // namespace posfet
