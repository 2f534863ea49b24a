// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/hum_lock.hpp"

#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// Power of the walks of frequency [rad^2/s^3] and size [1/s].
constexpr double kFrequencyPower = kTurn * kTurn * kFrequencyWalk * kFrequencyWalk;
constexpr double kSizePower = kSizeWalk * kSizeWalk;

}  // namespace

void HumLock::begin(double duration, double variance) {
  const double half = 0.5 * duration;
  frequency_ = 2.0 * variance / (duration * duration) + kFrequencyPower * duration;
  both_ = half * frequency_;
  phase_ = variance + half * both_;
  size_ = variance;
}

void HumLock::advance(double duration) {
  const double power = kFrequencyPower * duration;
  phase_ += duration * (2.0 * both_ + duration * (frequency_ + power / 3.0));
  both_ += duration * (frequency_ + 0.5 * power);
  frequency_ += power;
  size_ += kSizePower * duration;
}

HumLock::Gains HumLock::measure(double duration, double variance) {
  const double half = 0.5 * duration;
  const double of_phase = phase_ - half * both_;
  const double of_frequency = both_ - half * frequency_;
  const double expected = of_phase - half * of_frequency + variance;
  const Gains gains{of_phase / expected, of_frequency / expected, size_ / (size_ + variance)};
  phase_ -= gains.phase * of_phase;
  both_ -= gains.phase * of_frequency;
  frequency_ -= gains.frequency * of_frequency;
  size_ -= gains.size * size_;
  return gains;
}

}  // namespace posfet
