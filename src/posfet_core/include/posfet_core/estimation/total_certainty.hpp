// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Whether the total force is certain enough to be valid.
#pragma once

#include <array>
#include <cstddef>

#include "posfet_core/estimation/release_detector.hpp"

namespace posfet {

/// Compares the deviation of the total force with the least that the force may be until the end of the next block; in a
/// release, which makes it small before it is found, with the greatest of the last blocks.
class TotalCertainty {
public:
  /// Contact threshold [N].
  explicit TotalCertainty(double threshold) : threshold_(threshold) {}

  /// Forget the forces of the last blocks.
  void start() { recent_.fill(0.0); }

  /// Take the total force of a block [N].
  void add(double total);

  /// Whether that force is certain enough, by its deviation and that of its noise [N]: no more than a share of the
  /// force, or than the threshold; and no object pulls.
  bool is_certain(double deviation, double noise, double most) const;

private:
  /// By how much the force has fallen at most from one of the last blocks to the next [N].
  double steepest_fall() const;

  double threshold_;
  double total_ = 0.0;
  std::array<double, kStillBlocks + ReleaseDetector::kReleasedBlocks> recent_{};  ///< Sizes [N].
  std::size_t next_ = 0;
};

}  // namespace posfet
