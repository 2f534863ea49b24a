// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Mains hum of all taxels: subtracted scan by scan, with the signals kept from which it is estimated.
///
/// Amplitudes, phase and frequency are estimated at the end of a window; mains_hum.hpp.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

namespace posfet {

/// Orders of the harmonics of a hum: the fundamental, and those that rectifiers and saturated iron cause [1].
constexpr std::array<int, 3> kHumOrders{1, 3, 5};

/// Subtracts the hum of signals in any unit.
class HumFilter {
public:
  /// What the estimator sets, and what it estimates from.
  struct State {
    bool present = false;    ///< Whether a hum is subtracted.
    bool sampling = false;   ///< Whether the signals of the scans are kept.
    double frequency = 0.0;  ///< [Hz].
    double phase = 0.0;  ///< Of the fundamental at the start of the window [rad]; those of the others are multiples.
    double time = 0.0;   ///< Since then [s].
    std::size_t filled = 0;  ///< Number of scans in the window.
  };

  /// Number of taxels, and of the scans of a window; 0: nothing is ever kept.
  HumFilter(std::size_t taxels, std::size_t scans);

  std::size_t taxels() const { return taxels_; }
  std::size_t scans() const { return times_.size(); }
  State& state() { return state_; }
  const State& state() const { return state_; }

  /// Cosine and sine parts of each taxel's hum in the order of kHumOrders, in the unit of the signals,
  /// [orders, 2, taxels].
  std::vector<double>& parts() { return parts_; }
  const std::vector<double>& parts() const { return parts_; }

  /// Signals of the window, [scans, taxels].
  std::vector<double>& window() { return window_; }

  /// Times of its scans since its start [s].
  std::vector<double>& times() { return times_; }

  /// Subtract the hum from the signals of a scan, `step` seconds after the one before, in place; keep the rest.
  void remove(double* signal, double step);

  /// Begin a new window, from the phase at the end of this one.
  void start_window();

  /// Subtract nothing from now on.
  void clear();

private:
  State state_;
  std::size_t taxels_;
  std::vector<double> parts_;
  std::vector<double> window_;
  std::vector<double> times_;
};

}  // namespace posfet
