// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// States of the force errors that all taxels share: their positions.
#pragma once

#include <array>
#include <cstddef>

namespace posfet {

constexpr std::size_t kChip = 0;         ///< Temperature of the chip since the start [K].
constexpr std::size_t kRate = 1;         ///< Its rate of change [K/s].
constexpr std::size_t kFilm = 2;         ///< Temperature of the film since the start [K]: follows the chip.
constexpr std::size_t kSensor = 3;       ///< Temperature of the sensors since the start [K]: follows the chip.
constexpr std::size_t kLag = 4;          ///< Natural logarithm of the time constant of the sensors' lag in seconds [1].
constexpr std::size_t kScale = 5;        ///< Relative error of the sensors' scale [1].
constexpr std::size_t kEarlier = 6;      ///< Rate at which the film has warmed since before the start, which no charge
                                         ///< shows [K/s]: the temperatures above are without it. Its charge is in the
                                         ///< offsets, which leak; at the leak rates of the calibration.
constexpr std::size_t kZero = 7;         ///< Error of the first reading of the sensors, which says what zero is [K].
constexpr std::size_t kThermal = 8;      ///< Number of the states that concern temperatures: those above.
constexpr std::size_t kBend = kThermal;  ///< Charge of bending on every taxel, as a force per total force [1].
constexpr std::size_t kBendX =
    kBend + 1;  ///< Its gradient: difference between the middle of the array and its edge in x [1].
constexpr std::size_t kBendY = kBend + 2;       ///< The same in y [1].
constexpr std::size_t kBendMoment = kBend + 3;  ///< The same as a force away from the middle causes it: a chip bends
                                                ///< around the place that is pressed [1].
constexpr std::size_t kBends = 4;               ///< Number of the states of bending, from kBend on.
constexpr std::size_t kLeak = kBend + kBends;  ///< Relative error of the leak rates that all taxels have in common [1].
constexpr std::size_t kWarmth = 13;            ///< Temperature of the film of a touched taxel above the others [K].
constexpr std::size_t kWeakWarmth = 14;        ///< The same beyond what is expected where the force is weak [K].
constexpr std::size_t kTail = 15;   ///< Force that the cover lets an untouched taxel feel, relative to that of a
                                    ///< geometric decline [1].
constexpr std::size_t kDrift = 16;  ///< What the offsets of all taxels have in common, as a rate of the force errors
                                    ///< [N/s].
constexpr std::size_t kCreep = 17;  ///< First of the slow responses of the film to a force, relative to it [1].
constexpr std::size_t kCreeps = 3;  ///< Number of these.
constexpr std::size_t kSharedStates = kCreep + kCreeps;  ///< Number of shared states.

/// Whether a state is a response of a taxel to its own force. Those of a taxel beside a contact are part of its small
/// force, and tell nothing of the shared states.
constexpr bool is_of_touch(std::size_t state) {
  return state == kLeak || state == kWarmth || state == kWeakWarmth || state >= kCreep;
}

/// The direction in which one shared state changes, and no other.
inline std::array<double, kSharedStates> direction_of(std::size_t state) {
  std::array<double, kSharedStates> direction{};
  direction[state] = 1.0;
  return direction;
}

}  // namespace posfet
