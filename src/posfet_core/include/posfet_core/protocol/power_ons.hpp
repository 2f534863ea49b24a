// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// The number of the power-on that scans, status and responses of a board state.
#pragma once

#include <optional>

#include "posfet_core/protocol/scan_statistics.hpp"

namespace posfet::protocol {

/// Bits of the status of a scan: those that a board sends are the lowest four.
constexpr unsigned kBoardFlags = 0xF;
constexpr unsigned kBoardReset = 16;
constexpr unsigned kTimeEstimated = 32;
constexpr unsigned kSequenceEstimated = 64;
constexpr unsigned kChargeReset = 128;

/// Follows the number of the power-on.
class PowerOns {
public:
  /// Number of times that the board was reset.
  Counter resets() const { return resets_; }

  /// Note the number that a message or a scan states; return whether the board was reset since the one before.
  bool note(int boot) {
    if (boot == boot_) {
      return false;
    }
    previous_ = boot_;
    boot_ = boot;
    resets_ += previous_ ? 1U : 0U;
    return previous_.has_value();
  }

  /// Note the number and the charge that a status states; return whether the board was reset before it.
  bool note_status(int boot, bool charge_reset) {
    charge_reset_ |= !status_ && charge_reset;
    status_ = Stated{boot, charge_reset};
    return note(boot);
  }

  /// Whether what states a number is late: the board was reset since.
  bool is_over(int boot) const { return boot == previous_; }

  /// The bits of the status that say what was reset before the next scan, which states a number, and with which the
  /// sequence may have `restarted`.
  unsigned flags(int boot, bool restarted) {
    unsigned flags = 0;
    if (restarted) {
      flags = keeps_charge(boot) ? kBoardReset : kBoardReset | kChargeReset;
      resets_ += boot == scan_boot_ ? 1U : 0U;  // else the new number tells
    }
    if (charge_reset_) {
      charge_reset_ = false;
      flags |= kChargeReset;
    }
    if (boot != scan_boot_) {
      scan_boot_ = boot;
      note(boot);
    }
    return flags;
  }

private:
  struct Stated {
    int boot = 0;
    bool charge_reset = false;
  };

  /// Whether the board, since its newest power-on, has said that charges continue those from before.
  bool keeps_charge(int boot) const { return status_ && status_->boot == boot && !status_->charge_reset; }

  Counter resets_ = 0;
  std::optional<int> boot_;       ///< Newest number.
  std::optional<int> previous_;   ///< The one before.
  std::optional<int> scan_boot_;  ///< Of the newest scan.
  std::optional<Stated> status_;  ///< The newest one.
  bool charge_reset_ = false;     ///< The first status says so, of a board that an earlier driver may have received.
};

}  // namespace posfet::protocol
