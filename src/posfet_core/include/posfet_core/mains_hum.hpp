// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Mains hum: estimated where nothing touches and subtracted everywhere, in contacts as well.
///
/// All taxels hum at one frequency, each with its own amplitude and phase. These are estimated in windows of whole
/// periods without touch. Phase, frequency and the size of all drift, and are tracked in every window by a Kalman
/// filter: on the taxels that are not in contact, so that a touch that vibrates at the mains frequency is
/// preserved. Where too few taxels are untouched, what all have in common at that frequency counts as hum.
///
/// A hum is found, and its phase and frequency are tracked, by the fundamental. Its third and fifth harmonics have
/// multiples of that phase, and amplitudes and phases of their own on each taxel. Others stay, as do those that the
/// rate of the scans does not show.
#pragma once

#include <array>
#include <complex>
#include <cstddef>
#include <vector>

#include "posfet_core/flags.hpp"
#include "posfet_core/hum_filter.hpp"
#include "posfet_core/hum_lock.hpp"

namespace posfet {

/// Nominal mains frequencies [Hz].
constexpr std::array<double, 2> kMainsFrequencies{50.0, 60.0};

/// Window in which a phase is measured [s]: whole periods of each of `kMainsFrequencies`.
constexpr double kHumWindow = 0.1;

/// Least number of scans in a period with which the hum is distinguishable from other signals [1].
constexpr double kScansPerPeriod = 2.5;

/// Share of that to which the rate of a window's scans may fall [1]: some are lost.
constexpr double kLeastRate = 0.9;

/// Time between two searches for hum while there is none [s].
constexpr double kSearchPause = 0.5;

/// Least amplitude of a hum, in standard deviations of the noise in a window [1].
constexpr double kDetection = 5.0;

/// A hum of less than this many standard deviations of a reading's noise is not subtracted [1].
constexpr double kLeastAmplitude = 0.2;

/// A hum of more than this many standard deviations of a reading's noise is strong [1].
constexpr double kStrongAmplitude = 5.0;

/// Greatest deviation of the phase from its prediction between two windows [rad].
constexpr double kLargestPhaseChange = 1.0;

/// Least share of a taxel's individual error by which it is corrected [1]; at first the mean of all windows is taken.
constexpr double kIndividualGain = 0.1;

/// Greatest relative change of amplitude [1] and greatest change of phase [rad] by one window.
constexpr double kLargestHumStep = 0.5;

/// Least share of untouched taxels among all working ones from which the hum is estimated [1].
constexpr double kFewestFree = 0.2;

/// Estimates and subtracts the hum of signals in any unit, scan by scan: `remove` subtracts it from the signals of a
/// scan, and keeps them for the estimation; required while `sampling`.
class MainsHum : public HumFilter {
public:
  /// `rate` is the number of scans per second [Hz]: too low a one to find hum switches the search off. `noise` is the
  /// standard deviation of a reading, in the unit of the signals.
  MainsHum(std::size_t taxels, double rate, double noise);

  /// Whether the rate suffices to find hum.
  bool searches() const { return scans() > 0; }

  /// Frequency of the hum [Hz]; NaN: no hum.
  double frequency() const;

  /// Root mean square of the taxels' amplitudes of the fundamental, in the unit of the signals.
  double amplitude() const;

  /// Whether a hum is subtracted without which the signals say little.
  bool strong() const { return state().present && amplitude() > strong_; }

  /// Forget what was seen of the window that an interruption has ended; the scan path has cleared the hum.
  void forget();

  /// End a block of scans of a duration [s]: the taxels that were touched in it, and the faulty ones. Processes the
  /// window when it is complete.
  void close_block(const bool* touched, const bool* ignored, double duration);

private:
  using Phasor = std::complex<double>;

  bool shows_hum();
  bool find_free(const bool* ignored);
  void detect();
  void begin(double phase_change);
  void track(bool touched);
  void correct(std::size_t index, double gain, double in_phase, double lead);
  void scale(double factor);
  void reset();
  void restart_window();
  void correlate(double frequency, std::size_t index);
  Phasor common_phasor() const;

  std::size_t orders_ = 0;  ///< Number of orders that the rate shows.
  double noise_of_window_;
  double least_;
  double strong_;
  std::vector<double> weights_;   ///< Hann window: suppresses slow changes.
  double pause_ = 0.0;            ///< What is left of the pause [s].
  TaxelFlags touched_;            ///< In the window.
  TaxelFlags free_;               ///< Taxels from which the hum is estimated.
  std::size_t free_count_ = 0;    ///< Their number.
  std::vector<double> measured_;  ///< Cosine and sine parts of the window's signals at one order, [2, taxels].
  bool suspected_ = false;
  Phasor before_;  ///< Mean of the free taxels in the previous window, where a hum was suspected.
  std::size_t windows_ = 0;
  HumLock lock_;
};

}  // namespace posfet
