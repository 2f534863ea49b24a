// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Times of the ticks between two classic headers.
///
/// A header states when its scan was sampled. That is the time of its tick, or later when the board was busy, but by
/// less than a period, and never earlier. The ticks are therefore a line with the headers on it or above: its slope is
/// the median of the steps between the newest headers, and it runs through the earliest of them.
///
/// Where a header contradicts the line, or another host sets the period, the next headers decide on the period.
#pragma once

#include <cstdint>

#include "posfet_core/protocol/integers.hpp"
#include "posfet_core/protocol/recent.hpp"

namespace posfet::protocol {

/// Newest steps from header to header of which the period is the median; assumed.
constexpr std::size_t kSteps = 5;

/// Steps for which the nominal period counts [1]: it holds against that many others.
constexpr std::size_t kNominal = 2;

/// Steps that confirm a period which another host may have set: the first may have begun before.
constexpr int kConfirming = 2;

/// Difference of times that are rounded to microseconds, from header to header [us].
constexpr double kAgreement = 20.0;

/// Time by which a tick may be sampled late [scan periods]; later, and period or sequence have changed. Assumed.
constexpr double kLatestTick = 0.95;

/// The ticks of a board's scan timer, on the board's clock: equidistant, as long as the period is the same.
class TickLine {
public:
  /// Scan period [us], as announced, or as measured when most of the newest headers contradict that.
  double period() const { return period_; }

  /// Scan period [us], as announced, or as measured when two steps contradict that alike.
  double nominal() const { return nominal_; }

  /// Whether the newest header shows that those before were sampled late.
  bool lowered() const { return lowered_; }

  /// Whether two headers lie on the line: one alone may have been sampled late.
  bool agreed() const { return agreed_; }

  /// Whether the period is certain: the times of the ticks since the newest header are.
  bool certain() const { return unconfirmed_ == 0; }

  /// Whether the newest header is on one line with the one before.
  bool continued() const { return headers_.size() > 1; }

  /// Whether a scan is between two headers of the line.
  bool spans(std::int64_t sequence) const { return continued() && headers_.front().sequence <= sequence; }

  /// Forget all headers: the board announces a scan period [us], or has restarted.
  void restart(double period);

  /// Note that the period may be another one from one of the ticks to come on.
  void question() { unconfirmed_ = kConfirming; }

  /// Take a header: sequence and time [us] of its scan, unwrapped, the latter `estimated` if it is counted on by the
  /// sequence: then it measures nothing.
  void add(std::int64_t sequence, Wide time, bool estimated);

  /// The time of the tick of a scan since the newest header [us].
  Wide time(std::int64_t sequence) const;

private:
  struct Header {
    std::int64_t sequence = 0;
    Wide time = 0;
  };

  void measure(std::int64_t scans, Wide elapsed, bool estimated);
  double median_period() const;

  double period_ = 0.0;
  double nominal_ = 0.0;
  double announced_ = 0.0;
  int unconfirmed_ = 0;                 ///< Steps that have to fit before the period is certain again.
  double contradiction_ = 0.0;          ///< Step before that does not fit [us]; 0: it did.
  Recent<double, kSteps> steps_;        ///< Periods from one header to the next [us].
  Recent<Header, kSteps + 1> headers_;  ///< On one line.
  Header newest_;
  double tick_ = 0.0;
  bool lowered_ = false;
  bool agreed_ = false;
};

}  // namespace posfet::protocol
