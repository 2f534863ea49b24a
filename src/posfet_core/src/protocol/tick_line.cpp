// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/protocol/tick_line.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "posfet_core/protocol/scan_format.hpp"

namespace posfet::protocol {

void TickLine::restart(double period) {
  announced_ = nominal_ = period_ = period;
  unconfirmed_ = 0;
  contradiction_ = 0.0;
  steps_.clear();
  headers_.clear();
}

void TickLine::add(std::int64_t sequence, Wide time, bool estimated) {
  const std::int64_t scans = sequence - newest_.sequence;
  if (!headers_.empty()) {
    measure(scans, time - newest_.time, estimated);
  }
  const double expected = tick_ + static_cast<double>(scans) * period_;
  newest_ = {sequence, time};
  headers_.add(newest_);
  Recent<double, kSteps + 1> ticks;
  for (const Header& header : headers_) {
    ticks.add(real(header.time) + static_cast<double>(sequence - header.sequence) * period_);
  }
  tick_ = *std::min_element(ticks.begin(), ticks.end());
  agreed_ = std::count_if(ticks.begin(), ticks.end(), [this](double tick) { return tick - tick_ <= kAgreement; }) > 1;
  lowered_ = continued() && expected - tick_ > kAgreement;
}

Wide TickLine::time(std::int64_t sequence) const {
  return rounded(tick_ + static_cast<double>(sequence - newest_.sequence) * period_);
}

/// Take the step from the header before: that of some scans, and a time [us].
void TickLine::measure(std::int64_t scans, Wide elapsed, bool estimated) {
  const auto count = static_cast<double>(scans);
  if (std::abs(real(elapsed) - count * period_) <= kLatestTick * period_) {
    unconfirmed_ = std::max(unconfirmed_ - 1, 0);
    contradiction_ = 0.0;
    if (scans <= kHeaderScans && !estimated) {
      steps_.add(real(elapsed) / count);
      period_ = median_period();
    }
    return;
  }
  const double step = 0 < scans && scans <= kHeaderScans ? real(elapsed) / count : 0.0;
  const bool measured = std::abs(step - contradiction_) <= kLatestTick * step / kHeaderScans && step > 0.0;
  nominal_ = period_ = measured ? step : announced_;
  unconfirmed_ = measured ? 0 : std::max(unconfirmed_, 1);
  contradiction_ = step;
  steps_.clear();
  headers_.clear();
}

double TickLine::median_period() const {
  std::array<double, kNominal + kSteps> periods{};  // in order
  std::fill_n(periods.begin(), kNominal, nominal_);
  std::size_t count = kNominal;
  for (const double step : steps_) {
    auto* const end = periods.data() + count++;
    auto* const place = std::upper_bound(periods.data(), end, step);
    std::move_backward(place, end, end + 1);
    *place = step;
  }
  return count % 2 != 0 ? periods[count / 2] : (periods[count / 2 - 1] + periods[count / 2]) / 2.0;
}

}  // namespace posfet::protocol
