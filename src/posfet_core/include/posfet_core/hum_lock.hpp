// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What is tracked of a mains hum: its phase, its frequency, and the size that all taxels have in common; frequency and
/// size are random walks.
#pragma once

namespace posfet {

/// Deviation by which the mains frequency changes in a second [Hz] (assumed): a random walk.
constexpr double kFrequencyWalk = 0.05;

/// Deviation by which the size of a hum changes in a second, relative to it [1] (assumed): a random walk.
constexpr double kSizeWalk = 0.1;

/// Kalman filter of the phase at the end of a window [rad], the frequency [rad/s] and the relative size [1] of a hum.
class HumLock {
public:
  /// Shares of a window's errors by which phase, frequency [1/s] and size are corrected.
  struct Gains {
    double phase = 0.0;
    double frequency = 0.0;
    double size = 0.0;
  };

  /// Begin with a phase whose variance in the middle of a window of a duration [s] is known, and a frequency that is
  /// the difference of two such phases.
  void begin(double duration, double variance);

  /// A window of a duration [s] has gone by.
  void advance(double duration);

  /// Gains for errors that were measured in that window, of phase (in its middle) and size, with a variance each.
  Gains measure(double duration, double variance);

  /// The size to which errors are relative was multiplied by a factor.
  void scale(double factor) { size_ /= factor * factor; }

private:
  double phase_ = 0.0;      ///< Variance [rad^2].
  double both_ = 0.0;       ///< Covariance of phase and frequency [rad^2/s].
  double frequency_ = 0.0;  ///< Variance [rad^2/s^2].
  double size_ = 0.0;       ///< Variance [1].
};

}  // namespace posfet
