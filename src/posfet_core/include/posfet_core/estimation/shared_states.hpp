// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// States of the force errors that all taxels share; in the order of `Shared` in
/// posfet_model/estimation/error_states.py, which explains them.
#pragma once

#include <cstddef>

namespace posfet {

constexpr std::size_t kChip = 0;     ///< Temperature of the chip since the start [K].
constexpr std::size_t kRate = 1;     ///< Its rate of change [K/s].
constexpr std::size_t kFilm = 2;     ///< Temperature of the film since the start [K].
constexpr std::size_t kSensor = 3;   ///< Temperature of the sensors since the start [K].
constexpr std::size_t kLag = 4;      ///< Natural logarithm of the time constant of the sensors' lag in seconds [1].
constexpr std::size_t kScale = 5;    ///< Relative error of the sensors' scale [1].
constexpr std::size_t kThermal = 6;  ///< Number of the states that concern temperatures: those above.

}  // namespace posfet
