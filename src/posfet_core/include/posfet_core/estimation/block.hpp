// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What a block of scans measured, and the last ones of them.
#pragma once

#include <cstddef>
#include <vector>

#include "posfet_core/estimation/belief.hpp"
#include "posfet_core/estimation/shared_states.hpp"
#include "posfet_core/estimation/touch_response.hpp"
#include "posfet_core/flags.hpp"
#include "posfet_core/numbers.hpp"

namespace posfet {

/// Duration of a block, unless a scan takes longer [s].
constexpr double kBlock = 0.02;

/// Blocks from one window of blocks to the next, which has most of its blocks in common with it.
constexpr std::size_t kHop = 4;

/// Blocks over which all is still once it counts as such [1]: 0.1 s.
constexpr std::size_t kStillBlocks = 5;

/// What passes in a block, or in several, as far as the taxels share it.
struct Passage {
  double duration = 0.0;          ///< Its duration [s].
  double leak = 1.0;              ///< Rate of the leakage, relative to that of the calibration [1].
  double span = 0.0;              ///< Time from the middle of the block before to its own [s].
  double reading = kUnknown;      ///< New mean reading of the temperature sensors [K]; NaN: none.
  double reading_variance = 0.0;  ///< Variance of its noise [K2].
  double interval = 0.0;          ///< Time since the reading before [s].
  double unlikely = 0.0;     ///< Twice the negative logarithm of the likelihood of the reading, as zeros let expect
                             ///< it, up to a constant [1].
  double leaked_time = 0.0;  ///< Time since the temperatures began, as one with the leak rates of the
                             ///< calibration [s]: offsets have leaked for so long.
  double moved_share = 0.0;  ///< Share of the force that has moved from taxel to taxel [1].
  double tail_moved = 0.0;   ///< Share of the tail that is new [1].
  double rate_noise = 0.0;   ///< Variance that the rate of the chip temperature gains as the total force changes
                             ///< [K2/s2].
  double leak_noise = 0.0;   ///< Variance that the relative error of the leak rates gains [1].
  double warming = 0.0;      ///< Rate of the chip temperature that the touch is expected to cause [K/s].
};

/// What a block measured: kept until no touch can have begun in it. Arrays have one value for each taxel.
struct Block : Passage {
  Block(std::size_t taxels, TouchResponse touch);

  /// Whether a taxel is beside a contact: its force is a small one.
  bool is_small(std::size_t taxel) const { return !touched[taxel] && neighbour[taxel] > 0.0; }

  /// Touch the taxels that something wide presses: all of which is known what no force is.
  void touch_all(const TaxelFlags& offset_known, const TaxelFlags& ignored) {
    for (std::size_t taxel = 0; taxel < touched.size(); ++taxel) {
      touched[taxel] = touched[taxel] || (offset_known[taxel] && !ignored[taxel]);
    }
  }

  std::vector<double> mean;       ///< Mean of the uncorrected forces F^ [N].
  std::vector<double> noise;      ///< Variance of its noise [N2].
  std::vector<double> charge;     ///< Mean of the charge, as a force, up to a constant [N].
  TaxelFlags listed;              ///< Taxels in contact.
  TaxelFlags touched;             ///< These, and those whose residual was unexplained.
  std::vector<double> response;   ///< Responses of the force errors to the shared states, [taxels, states].
  std::vector<double> neighbour;  ///< Greatest force of a neighbour [N]; 0 where nothing touches.
  std::vector<double> tail;       ///< Force of an untouched taxel if forces declined geometrically away from the
                                  ///< contact [N].
  std::vector<double> own_noise;  ///< Covariance of the process noise of each taxel, [taxels, own, own].
  std::vector<double> cooled;     ///< Share of its warmth that each taxel has lost [1].
  Belief before;                  ///< Belief before this block.
  TouchResponse touch_before;     ///< What touches have left until then.
};

/// What a belief says of the errors that the responses to a touch depend on, at the leakage of a block.
TouchResponse::Known known_errors(const Belief& belief, const Passage& block);

/// Offset of the signal of a taxel with this time constant of the leakage [s], with what all have in common [N].
inline double offset_of(const Belief& belief, std::size_t taxel, double time_constant) {
  return belief.error_of(taxel)[kOffset] + time_constant * belief.shared[kDrift];
}

/// The last blocks, oldest first, and a place for the next one.
class LastBlocks {
public:
  /// Number of blocks that are processed again when a touch begins: 0.3 s, assumed to be the weak part of a touch. A
  /// board with fewer than 50 scans per second has a block for each: then they last longer.
  static constexpr std::size_t kLag = 16;

  /// Number of them from which taxels are left out that do not show the touch themselves.
  static constexpr std::size_t kSuspected = kLag / 2;

  LastBlocks(std::size_t taxels, const TouchResponse& touch);

  std::size_t size() const { return size_; }
  bool full() const { return size_ == kLag; }
  Block& operator[](std::size_t index) { return places_[(first_ + index) % places_.size()]; }
  const Block& operator[](std::size_t index) const { return places_[(first_ + index) % places_.size()]; }
  Block& newest() { return (*this)[size_ - 1]; }
  const Block& newest() const { return (*this)[size_ - 1]; }

  /// Time that the blocks have lasted [s].
  double duration() const;

  /// Times of the middles of the blocks, since that of the block before the oldest [s].
  Vector<double> times() const;

  /// Where the next block is measured; kept only after `push`.
  Block& next() { return (*this)[size_]; }

  /// Keep that block, and forget the oldest one if there are too many.
  void push();

  /// Forget all; what they hold stays as it is until the next block is measured.
  void clear() { size_ = 0; }

private:
  std::vector<Block> places_;
  std::size_t first_ = 0;
  std::size_t size_ = 0;
};

}  // namespace posfet
