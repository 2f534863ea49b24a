// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Admission of scans, and the time interval between them.
#pragma once

#include <cstdint>

#include "posfet_core/scan.hpp"

namespace posfet {

/// Longest interval across which the force is tracked, in time constants of the leakage [1]; after a longer one little
/// charge is left.
constexpr double kLongestGap = 2.0;

/// Greatest step of the sequence to a scan that closely follows the one before [1], assumed: until then little charge
/// leaks, and no more scans than that are refused in a row for bursts.
constexpr std::int64_t kClose = 4;

/// An interval this many times longer than the missing scans explain is a clock jump [1].
constexpr double kJumpFactor = 4.0;

/// Least difference that counts as a clock jump [s].
constexpr double kJumpLeast = 0.02;

/// Relative difference up to which two such intervals in a row are the same [1]: the board was set to a lower rate.
constexpr double kSameInterval = 0.1;

/// Gain of an interval by the board clock in the estimate of the period [1].
constexpr double kPeriodGain = 0.01;

/// The same for arrival times, whose jitter must be averaged [1].
constexpr double kEstimatedGain = 0.001;

/// Number of consecutive late scans after which the board is assumed to have restarted.
constexpr int kMostLate = 10;

/// Numbers of scans and events since the start, by cause; posfet_model/reconstruction/scan_clock.py explains each.
struct ScanCounts {
  std::uint64_t accepted = 0;
  std::uint64_t layout_mismatch = 0;
  std::uint64_t repeated = 0;
  std::uint64_t late = 0;
  std::uint64_t adc_fault = 0;
  std::uint64_t implausible = 0;
  std::uint64_t bursts = 0;
  std::uint64_t missed = 0;
  std::uint64_t resets = 0;
  std::uint64_t time_jumps = 0;
  std::uint64_t gaps = 0;
};

/// Admits scans one by one; the other accessors describe the interval before the last admitted one.
class ScanClock {
public:
  /// Identifier of the layout, its number of taxels, time constant of the leakage [s] and nominal scan rate [Hz].
  ScanClock(std::uint64_t layout, std::size_t taxels, double leak_time_constant, double scan_rate);

  std::size_t taxels() const { return taxels_; }

  /// Whether a scan has the layout of this sensor; counts it otherwise.
  bool fits(const Scan& scan);

  /// Whether a scan that fits is neither duplicate nor late; counts it otherwise.
  bool is_new(const Scan& scan);

  /// Whether the board reports no ADC fault; counts it otherwise.
  bool is_sound(const Scan& scan);

  /// Note a scan that is new, and refused for its content: it is not missing.
  void refuse(const Scan& scan);

  /// Accept a scan that fits, is new and sound; set the interval before it.
  void admit(const Scan& scan);

  ScanCounts& counts() { return counts_; }
  const ScanCounts& counts() const { return counts_; }

  /// Interval before the scan [s], > 0.
  double step() const { return step_; }

  /// Whether the interval is unknown, or too long to track the force.
  bool interrupted() const { return interrupted_; }

  /// Whether at most a few scans were lost or refused since the one before: charge has hardly leaked.
  bool close() const { return close_; }

  /// Whether the interval was derived from the sequence or the stamps for lack of a valid device time.
  bool suspect() const { return suspect_; }

  /// Estimated period of the scans [s].
  double period() const { return period_; }

private:
  void note_restart(const Scan& scan);
  void reset(const Scan& scan);
  void measure(const Scan& scan, std::int64_t ahead);
  void bridge(double interval);
  void update_period(double interval, double gain);

  std::uint64_t layout_;
  std::size_t taxels_;
  double longest_;
  double period_;
  double shortest_period_;  ///< Of scans that are stamped as they arrive [s],
  double longest_period_;   ///< and longest one.
  double odd_ = 0.0;        ///< The last interval, if it was a clock jump [s]; 0: it was none.
  ScanCounts counts_;
  double step_;
  bool interrupted_ = false;
  bool close_ = false;
  bool suspect_ = false;
  bool started_ = false;          ///< Whether a scan was admitted.
  std::uint64_t sequence_ = 0;    ///< Of the last admitted scan.
  std::int64_t device_time_ = 0;  ///< Of it [us].
  std::int64_t stamp_ = 0;        ///< Of it [ns].
  bool estimated_ = true;         ///< Whether its time was estimated.
  std::uint64_t arrivals_ = 0;    ///< Number of intervals by arrival times.
  int late_in_a_row_ = 0;
  std::int64_t refused_ = 0;          ///< Number of different scans after it that were refused for their content,
  std::uint64_t newest_refused_ = 0;  ///< and the sequence of the newest of them.
  std::uint32_t restart_ = 0;         ///< Flags of restarts since then, also of scans that were refused.
  std::int64_t restarted_ = 0;        ///< Stamp of the newest scan with such a flag [ns].
};

}  // namespace posfet
