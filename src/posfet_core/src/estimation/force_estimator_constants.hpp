// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What several files of the force estimator use.
#pragma once

#include <cstddef>

#include "posfet_core/estimation/shared_states.hpp"

namespace posfet {

/// Deviations from which on a residual is no error that the filter expects [1].
constexpr double kGate = 5.0;

/// A taxel restarts when its force exceeds this many times the greatest force of the device [1]; a saturated taxel may
/// exceed the greatest force.
constexpr double kRunaway = 4.0;

/// Deviations from which on a reading of the temperature sensors, or one of few other measurements, is unexpected [1].
constexpr double kSurprising = 3.0;

/// Change of its temperature that no film survives [K]: a taxel whose response to it would not matter has none.
constexpr double kHottest = 1e3;

// Causes of errors that the forces share: the shared states, and these.
constexpr std::size_t kOfGain = kSharedStates;
constexpr std::size_t kOfWarmerFilm = kOfGain + 1;  ///< The hypothesis of one.
constexpr std::size_t kOfSlowPress = kOfGain + 2;
constexpr std::size_t kOfObject = kOfGain + 3;  ///< The one that touches.
constexpr std::size_t kOfLostScans = kOfGain + 4;
constexpr std::size_t kCauses = kOfLostScans + 1;  ///< Number of them all.

}  // namespace posfet
