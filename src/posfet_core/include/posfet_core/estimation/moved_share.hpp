// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// How much of a touch moves from taxel to taxel.
#pragma once

#include <cstddef>
#include <vector>

namespace posfet {

/// Follows each taxel's share of the total force. It does so with a play, as tremor and errors change shares, too:
/// those of weak forces lag behind.
class MovedShare {
public:
  explicit MovedShare(std::size_t taxels) : share_(taxels, 0.0) {}

  /// Process the forces of the touched taxels in a block, 0 of the others, with their standard deviations [N]. Returns
  /// the share of the force that has moved since the block before [1].
  double update(const std::vector<double>& force, const std::vector<double>& deviation);

private:
  std::vector<double> share_;
};

}  // namespace posfet
