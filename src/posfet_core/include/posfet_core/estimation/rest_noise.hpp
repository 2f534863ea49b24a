// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What the signals show of the noise that the filter has to expect, most of it while nothing touches.
#pragma once

#include <cstddef>
#include <vector>

#include "posfet_core/estimation/belief.hpp"
#include "posfet_core/estimation/block.hpp"
#include "posfet_core/estimation/estimated_array.hpp"
#include "posfet_core/estimation/jump_noise.hpp"
#include "posfet_core/estimation/temperature_walk.hpp"
#include "posfet_core/flags.hpp"

namespace posfet {

/// Observes steps of single signals, and the random walk of the temperature, in the stored blocks.
class RestNoise {
public:
  explicit RestNoise(const EstimatedArray& array);

  /// Noise of single taxels.
  const JumpNoise& jumps() const { return jumps_; }

  /// Random walk of the temperature.
  const TemperatureWalk& walk() const { return walk_; }

  /// Process the steps in the middle of the stored blocks, of the taxels that count; `at_rest`: also those that are no
  /// rises of the force, whatever they are, as these taxels show the film's temperature and nothing touches.
  void observe_steps(const LastBlocks& blocks, const Belief& belief, const TaxelFlags& counts, bool at_rest);

  /// Take a step of the signal of a taxel that was found otherwise [N].
  void admit_step(std::size_t taxel, double step) { jumps_.admit(taxel, step); }

  /// Process what the film's temperature did between the two oldest blocks, as the taxels that count show it.
  void observe_walk(const LastBlocks& blocks, const Belief& belief, const TaxelFlags& counts);

  /// Forget the temperatures: the next ones do not follow them.
  void pause() { walk_.pause(); }

private:
  double add_change(const Block& from, const Block& to, const Belief& belief, const TaxelFlags& counts);

  const EstimatedArray& array_;
  JumpNoise jumps_;
  TemperatureWalk walk_;
  std::vector<double> change_;  ///< Changes of the mean forces [N].
  std::vector<double> step_;    ///< Steps of the signals [N].
};

}  // namespace posfet
