// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Random walk of the chip temperature, observed while nothing touches.
#pragma once

#include "posfet_core/numbers.hpp"

namespace posfet {

/// Random walk of the chip temperature, from second differences of the film's, which no constant rate affects.
///
/// The film follows the chip with the time constant tau. Where the chip walks with the intensity q, second differences
/// of the film's temperature over times W have the variance 2 q (W - tau g - tau g^2/2), g = 1 - exp(-W/tau).
class TemperatureWalk {
public:
  /// Time between two observed temperatures [s]: longer than the lag of a film.
  static constexpr double kLeastTime = 0.1;

  /// Number of observations over which the walk is averaged [1]: 10 s.
  static constexpr int kMemory = 100;

  /// Least random walk, and that until it is observed [K/sqrt(s)]; time constant of the film's lag behind the chip [s],
  /// >= 0.
  TemperatureWalk(double least, double film_lag)
      : least_(least * least), film_lag_(film_lag), intensity_(least * least) {}

  /// Forget the temperatures, as the next ones do not follow them.
  void pause();

  /// Process the rise of the film's temperature from one block to the next [K], with the variance of the noise of each
  /// of both temperatures [K2], and the time between the middles of the blocks [s].
  void observe(double rise, double variance, double duration);

  /// Variance by which the temperature grows in each second [K2/s].
  double intensity() const { return intensity_; }

private:
  double shown(double time) const;

  double least_;
  double film_lag_;
  double intensity_;
  int count_ = 1;
  double rate_ = kUnknown;  ///< Rate of the observation before [K/s].
  double rise_ = 0.0;       ///< Sums of the one that is not complete [K],
  double time_ = 0.0;       ///< and [s].
};

}  // namespace posfet
