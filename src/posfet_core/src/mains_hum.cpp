// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/mains_hum.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// Number of scans of a window; 0: the rate is too low.
std::size_t scans_of_window(double rate) {
  const bool enough = rate >= kScansPerPeriod * kMainsFrequencies.back();
  return enough ? static_cast<std::size_t>(std::nearbyint(kHumWindow * rate)) : 0;
}

double limited(double step) { return std::clamp(step, -kLargestHumStep, kLargestHumStep); }

}  // namespace

MainsHum::MainsHum(std::size_t taxels, double rate, double noise)
    : HumFilter(taxels, scans_of_window(rate)),
      least_(kLeastAmplitude * noise),
      strong_(kStrongAmplitude * noise),
      weights_(scans()),
      touched_(taxels),
      free_(taxels),
      measured_(2 * taxels) {
  while (orders_ < kHumOrders.size() && rate >= kScansPerPeriod * kHumOrders[orders_] * kMainsFrequencies.back()) {
    ++orders_;
  }
  const double count = std::max(static_cast<double>(scans()), 1.0);
  noise_of_window_ = noise * std::sqrt(3.0 / count);
  for (std::size_t scan = 0; scan < scans(); ++scan) {
    weights_[scan] = 2.0 / count * (1.0 - std::cos(kTurn * (static_cast<double>(scan) + 0.5) / count));
  }
}

double MainsHum::frequency() const {
  return state().present ? state().frequency : std::numeric_limits<double>::quiet_NaN();
}

double MainsHum::amplitude() const {
  double square = 0.0;
  for (std::size_t part = 0; part < 2 * taxels(); ++part) {
    square += parts()[part] * parts()[part];
  }
  return std::sqrt(square / static_cast<double>(taxels()));
}

void MainsHum::forget() {
  suspected_ = false;
  pause_ = 0.0;
  std::fill(touched_.data(), touched_.data() + taxels(), false);
}

void MainsHum::close_block(const bool* touched, const bool* ignored, double duration) {
  if (pause_ > 0.0) {
    pause_ -= duration;
    if (pause_ <= 0.0) {
      restart_window();
    }
    return;
  }
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    touched_[taxel] = touched_[taxel] || touched[taxel];
  }
  if (!searches() || state().filled < scans()) {
    return;
  }
  const bool untouched = find_free(ignored);
  if (!shows_hum()) {
    suspected_ = false;
  } else if (state().present) {
    track(touched_.any());
  } else if (untouched) {
    detect();
  }
  if (state().present || suspected_) {
    restart_window();
  } else {
    pause_ = kSearchPause;
    state().sampling = false;
  }
}

/// Whether the scans of the window followed each other fast enough: those of a board that is slower than described may
/// show a hum as an offset.
bool MainsHum::shows_hum() {
  const double span = times()[scans() - 1] - times()[0];
  return static_cast<double>(scans() - 1) >= kLeastRate * kScansPerPeriod * kMainsFrequencies.back() * span;
}

/// Find the taxels that work and were not touched in the window, or all that work where these are too few; return
/// whether they were not touched.
bool MainsHum::find_free(const bool* ignored) {
  std::size_t working = 0;
  free_count_ = 0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    free_[taxel] = !touched_[taxel] && !ignored[taxel];
    working += ignored[taxel] ? 0 : 1;
    free_count_ += free_[taxel] ? 1 : 0;
  }
  if (static_cast<double>(free_count_) >= std::max(1.0, kFewestFree * static_cast<double>(working))) {
    return true;
  }
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    free_[taxel] = !ignored[taxel];
  }
  free_count_ = working;
  return false;
}

/// Detect a persistent hum: two consecutive windows must agree.
void MainsHum::detect() {
  double frequency = kMainsFrequencies.front();
  Phasor now;
  for (const double each : kMainsFrequencies) {
    correlate(each, 0);
    const Phasor common = common_phasor();
    if (std::abs(common) > std::abs(now)) {
      frequency = each;
      now = common;
    }
  }
  const bool before = suspected_ && state().frequency == frequency;
  suspected_ =
      std::abs(now) > std::max(kDetection * noise_of_window_ / std::sqrt(static_cast<double>(free_count_)), least_);
  if (!suspected_) {
    return;
  }
  const double phase_change = std::arg(now * std::conj(before_));
  before_ = now;
  state().frequency = frequency;
  if (before && std::abs(phase_change) <= kLargestPhaseChange) {
    suspected_ = false;
    begin(phase_change);
  }
}

/// Subtract from now on the hum of the window; from taxels that are not free, what the free ones have in common.
void MainsHum::begin(double phase_change) {
  const std::size_t count = taxels();
  for (std::size_t index = 0; index < orders_; ++index) {
    correlate(state().frequency, index);
    const Phasor common = common_phasor();
    double* const of_cosine = parts().data() + 2 * index * count;
    double* const of_sine = of_cosine + count;
    for (std::size_t taxel = 0; taxel < count; ++taxel) {
      of_cosine[taxel] = free_[taxel] ? measured_[taxel] : common.real();
      of_sine[taxel] = free_[taxel] ? measured_[count + taxel] : -common.imag();
    }
  }
  const double duration = state().time;
  state().present = true;
  state().frequency += phase_change / (kTurn * duration);
  state().phase -= 0.5 * phase_change;  // it was measured in the middle of the window
  windows_ = 1;
  const double size = std::abs(before_);
  lock_.begin(duration, square(noise_of_window_) / (static_cast<double>(free_count_) * size * size));
}

/// Correct phase, frequency and size by the residual hum of the free taxels, and each taxel's while nothing touches.
void MainsHum::track(bool touched) {
  const std::size_t count = taxels();
  const double duration = state().time;
  lock_.advance(duration);
  if (free_count_ == 0) {
    return;
  }
  correlate(state().frequency, 0);
  double power = 0.0;
  double in_phase = 0.0;
  double lead = 0.0;
  double left = 0.0;
  for (std::size_t taxel = 0; taxel < count; ++taxel) {
    if (free_[taxel]) {
      const double cosine = parts()[taxel];
      const double sine = parts()[count + taxel];
      const double of_cosine = measured_[taxel];
      const double of_sine = measured_[count + taxel];
      power += cosine * cosine + sine * sine;
      in_phase += cosine * of_cosine + sine * of_sine;
      lead += sine * of_cosine - cosine * of_sine;
      left += of_cosine * of_cosine + of_sine * of_sine;
    }
  }
  if (power == 0.0) {
    reset();
    return;
  }
  in_phase /= power;
  lead /= power;
  // What is left of the window by the taxels' own errors, and by what touches them, is the noise of what they share.
  const double rest = left - power * (in_phase * in_phase + lead * lead);
  const double freedom = 2.0 * std::max(static_cast<double>(free_count_) - 1.0, 1.0);
  const double variance = std::max(rest / freedom, square(noise_of_window_)) / power;
  const HumLock::Gains gains = lock_.measure(duration, variance);
  if (!touched) {
    ++windows_;
    const double gain = std::max(1.0 / static_cast<double>(windows_), kIndividualGain);
    correct(0, gain, in_phase, lead);
    // Of the harmonics it is not measured what all taxels have in common, but by the phase of the fundamental.
    for (std::size_t index = 1; index < orders_; ++index) {
      correlate(state().frequency, index);
      correct(index, gain, 0.0, kHumOrders[index] * lead);
    }
  }
  const double error = limited(std::atan2(lead, 1.0 + in_phase));
  state().phase += (gains.phase - duration * gains.frequency) * error;  // at the start of the window
  state().frequency += gains.frequency * error / kTurn;
  scale(1.0 + gains.size * limited(in_phase));
}

/// Correct the parts of an order by what the window has left of them, beyond what all taxels have in common.
void MainsHum::correct(std::size_t index, double gain, double in_phase, double lead) {
  const std::size_t count = taxels();
  double* const of_cosine = parts().data() + 2 * index * count;
  double* const of_sine = of_cosine + count;
  for (std::size_t taxel = 0; taxel < count; ++taxel) {
    if (free_[taxel]) {
      const double cosine = of_cosine[taxel];
      const double sine = of_sine[taxel];
      of_cosine[taxel] += gain * (measured_[taxel] - in_phase * cosine - lead * sine);
      of_sine[taxel] += gain * (measured_[count + taxel] - in_phase * sine + lead * cosine);
    }
  }
}

/// Scale all amplitudes; drop the hum when it becomes negligible.
void MainsHum::scale(double factor) {
  lock_.scale(factor);
  for (double& part : parts()) {
    part *= factor;
  }
  if (amplitude() < 0.5 * least_) {
    reset();
  }
}

void MainsHum::reset() {
  clear();
  suspected_ = false;
}

void MainsHum::restart_window() {
  start_window();
  std::fill(touched_.data(), touched_.data() + taxels(), false);
  pause_ = 0.0;
}

/// Measure the cosine and sine parts of the window's signals at an order of a fundamental frequency [Hz].
void MainsHum::correlate(double frequency, std::size_t index) {
  const std::size_t count = taxels();
  std::fill(measured_.begin(), measured_.end(), 0.0);
  for (std::size_t scan = 0; scan < scans(); ++scan) {
    const double angle = kHumOrders[index] * (state().phase + kTurn * frequency * times()[scan]);
    const double cosine = std::cos(angle) * weights_[scan];
    const double sine = std::sin(angle) * weights_[scan];
    const double* const signal = window().data() + scan * count;
    for (std::size_t taxel = 0; taxel < count; ++taxel) {
      measured_[taxel] += cosine * signal[taxel];
      measured_[count + taxel] += sine * signal[taxel];
    }
  }
}

/// Mean of what was measured of the free taxels, as a phasor, whose angle is the phase lead.
MainsHum::Phasor MainsHum::common_phasor() const {
  Phasor sum;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (free_[taxel]) {
      sum += Phasor(measured_[taxel], -measured_[taxels() + taxel]);
    }
  }
  return sum / static_cast<double>(free_count_);
}

}  // namespace posfet
