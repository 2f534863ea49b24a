// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/protocol/clock_sync.hpp"

#include <algorithm>

namespace posfet::protocol {

double ClockSync::drift() const {
  const Wide drifting = std::max(state_.acquired - state_.undelayed, Wide{0});
  return state_.known ? real(2 * drifting) * kMaxDrift : kUnknown;
}

double ClockSync::lead() const {
  const double lead = std::min(state_.recent, state_.recent_before) - state_.offset;
  return state_.known ? std::max(lead, 0.0) : kUnknown;
}

double ClockSync::uncertainty() const {
  const bool settled = state_.doubted || state_.last - interrupted_ >= kWindow;
  return drift() + (settled ? lead() : 0.0) + excess();
}

double ClockSync::error(double late, double early, double delay) const {
  const double recent = std::min(state_.recent, state_.recent_before);
  if (recent > state_.offset) {
    early += recent - state_.offset;
  }
  early = std::min(early, delay);
  if (lowest_ < state_.offset) {
    late += state_.offset - lowest_;
  }
  const Wide drifting = state_.acquired - state_.undelayed;
  return (late > early ? late : early) + (drifting > 0 ? real(2 * drifting) * kMaxDrift : 0.0);
}

double ClockSync::delay(Wide device_time, Wide arrival) const {
  if (!state_.known) {
    return kUnknown;
  }
  return real(arrival - device_time * 1000) - state_.offset + real(arrival - state_.last) * kMaxDrift;
}

void ClockSync::reset() {
  state_ = SyncState();
  lowest_ = kUnlimited;
  settled_ = kNever;
}

void ClockSync::interrupt(Wide device_time, Wide arrival) {
  if (state_.known) {
    state_.recent = real(arrival - device_time * 1000);
    state_.recent_before = kUnlimited;
    interrupted_ = arrival;
  }
}

void ClockSync::doubt(Wide device_time, Wide arrival, double ahead) {
  if (state_.known) {
    widen(ahead, arrival);
    state_.doubted = true;
    state_.window_end = arrival + kWindow;
    state_.window_offset = real(arrival - device_time * 1000);
    state_.window_undelayed = state_.acquired;
    interrupt(device_time, arrival);
  }
}

void ClockSync::widen(double ahead, Wide arrival) {
  if (ahead > 0.0) {
    const double drift = real(2 * std::max(arrival - state_.undelayed, Wide{0})) * kMaxDrift;
    lowest_ = std::min(lowest_, state_.offset) - ahead * 1000.0 - drift;
    settled_ = arrival + kWindow;
  }
}

void ClockSync::restore(const SyncState& state) {
  if (state.known) {
    lowest_ = std::min(lowest_, state_.offset);
    settled_ = state_.last + kWindow;
    state_ = state;
  }
}

Wide ClockSync::to_monotonic(Wide device_time, Wide arrival) {
  const double difference = real(arrival - device_time * 1000);
  if (state_.known) {
    follow(device_time, arrival, difference);
  } else {
    state_.offset = state_.window_offset = state_.recent = difference;
    state_.acquired = state_.undelayed = state_.window_undelayed = arrival;
    state_.known = true;
    state_.window_end = arrival + kWindow;
  }
  state_.last = arrival;
  if (arrival >= state_.window_end) {
    end_window(arrival);
  }
  if (arrival >= settled_) {
    lowest_ = kUnlimited;
    settled_ = kNever;
  }
  return device_time * 1000 + rounded(state_.offset);
}

/// Lower the offset where a frame, which arrived later than its device time by a difference [ns], was less delayed.
void ClockSync::follow(Wide device_time, Wide arrival, double difference) {
  const Wide acquired = std::min(device_time * 1000 + truncated(state_.offset), arrival);
  double rise = 0.0;
  if (acquired > state_.acquired) {
    rise = real(acquired - state_.acquired) * kMaxDrift;
    state_.acquired = acquired;
  }
  double offset = state_.offset + rise;
  double of_window = state_.window_offset + rise;
  if (difference <= of_window) {
    of_window = difference;
    state_.window_undelayed = state_.acquired;
    if (difference <= offset) {
      offset = difference;
      state_.undelayed = state_.acquired;
    }
  }
  state_.offset = offset;
  state_.window_offset = of_window;
  const double since = state_.recent + rise;
  state_.recent = difference < since ? difference : since;
  state_.recent_before += rise;
}

/// Find the offset again, from the windows that are remembered.
void ClockSync::end_window(Wide arrival) {
  if (state_.doubted) {
    state_.windows.clear();
    state_.doubted = false;
  }
  state_.windows.add({state_.acquired, state_.window_offset, state_.window_undelayed});
  bool first = true;
  for (const SyncWindow& window : state_.windows) {
    const double offset = window.offset + real(state_.acquired - window.end) * kMaxDrift;
    if (first || offset < state_.offset || (offset == state_.offset && window.undelayed < state_.undelayed)) {
      state_.offset = offset;
      state_.undelayed = window.undelayed;
    }
    first = false;
  }
  state_.window_offset = kUnlimited;
  state_.window_end = arrival + kWindow;
  state_.recent_before = state_.recent;
  state_.recent = kUnlimited;
}

}  // namespace posfet::protocol
