// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Static force from the leaking charge signal: deterministic integration, and a filter of its errors.
///
/// The inverse of the leak gives a force F^ that is never corrected (force_integration.hpp). Its errors, and what else
/// generates charge besides the force, are the states of `ForceErrorFilter`, measured wherever a force is known
/// (known_forces.hpp):
///
///     F_i = F^_i - d_i - h_i.s
///
/// with the error d_i of taxel i, the states s that all taxels share (shared_states.hpp), and the responses h_i to them
/// (touch_response.hpp). Every block of 20 ms is one step of the filter. When a touch begins, the last blocks are
/// processed again without the taxels that it touches: the first, weak part of a touch is no zero (docs/estimation.md).
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "posfet_core/force_integration.hpp"
#include "posfet_core/grid.hpp"

namespace posfet {

/// Duration of a block [s].
constexpr double kBlock = 0.02;

/// Force of every taxel with its covariance, block by block; arrays row by row, [taxels].
///
/// The integration takes each scan; call `start` with the first one, and `close_block` whenever `block_time` has
/// reached the duration of a block. The force at the start is assumed to be zero: a taxel that is loaded then reads
/// zero, a negative force once the load is released, and zero soon after.
class ForceEstimator {
public:
  virtual ~ForceEstimator() = default;

  virtual std::size_t taxels() const = 0;
  virtual ForceIntegration& integration() = 0;
  virtual const ForceIntegration& integration() const = 0;

  /// Duration of the current block so far [s].
  double block_time() const { return integration().block().elapsed; }

  /// Duration from which on a block is due [s].
  virtual double block_duration() const = 0;

  /// Whether the forces of all taxels are valid.
  bool valid() const { return integration().block().valid; }

  /// Estimated force [N], positive when pushed; valid where `offset_known`.
  const std::vector<double>& force() const { return integration().state().force; }
  const TaxelFlags& offset_known() const { return integration().state().offset_known; }

  /// Faulty taxels, whose offsets `valid` does not depend on. Set by `ignore`.
  const TaxelFlags& ignored() const { return integration().state().ignored; }

  /// Faulty taxels that still show a touch: sums of forces lack one that is listed nowhere. Set by the caller.
  virtual TaxelFlags& informative() = 0;

  /// Number of restarts of taxels whose signal was consistent with no force.
  virtual std::size_t restarts() const = 0;

  /// Start with a scan of these charge densities [C/m2], which has no predecessor.
  virtual void start(const double* charge) = 0;

  /// Record that an unknown time passes before the next scan: changes of the force in it are unknown. Offsets stay
  /// known. At the next scan the force is set to the remaining charge, a lower bound of the force.
  virtual void interrupt() = 0;

  /// Process the block that is due: the taxels in contact at any time of it, and those of each contact. Has no effect
  /// where the offset is unknown: there a constant force is as informative as no force.
  virtual void close_block(const bool* touched, const std::vector<const Taxels*>& contacts) = 0;

  /// Set the faulty taxels; one that works again restarts with an unknown offset.
  virtual void ignore(const bool* faulty) = 0;

  /// Set the variance of a reading of each taxel [N2]; initially that of the description.
  virtual void set_noise_variance(const double* variance) = 0;

  /// Find the mean of `force` over the block that is due [N].
  virtual void block_mean(double* out) const = 0;

  /// Find the charge at each gate, as the force that would generate it [N].
  virtual void residual_charge(double* out) const = 0;

  /// Find the variance of each force that it does not share with others [N2].
  virtual void force_variance(double* out) const = 0;

  /// Find the variance that each force would have without a touch [N2]: without leaked charge, creep and warmth.
  virtual void variance(double* out) const = 0;

  /// Set the forces to zero, and start a new block; offsets stay, as they are estimated all the time. `forced`: forces
  /// may be applied; those of the newest scan are set to zero, and none remains a lower bound. Otherwise the mean
  /// forces of the last block are set to zero, which have less noise. The correction that was added to each force is
  /// written into `change` [N]; 0 for ignored taxels.
  virtual void tare(bool forced, double* change) = 0;

  /// Standard deviation of the total force, over the greatest total force of the last 0.16 s, above which the forces
  /// are not valid [1]; may change.
  double max_relative_uncertainty = 0.2;
};

}  // namespace posfet
