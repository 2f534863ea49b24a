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
/// (docs/estimation.md#when-a-force-is-known):
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

#include "posfet_core/estimation/absorbed_force.hpp"
#include "posfet_core/estimation/block.hpp"
#include "posfet_core/estimation/block_residuals.hpp"
#include "posfet_core/estimation/contact_surroundings.hpp"
#include "posfet_core/estimation/estimated_array.hpp"
#include "posfet_core/estimation/force_covariance.hpp"
#include "posfet_core/estimation/force_error_filter.hpp"
#include "posfet_core/estimation/hidden_touch.hpp"
#include "posfet_core/estimation/hot_film.hpp"
#include "posfet_core/estimation/lone_drift.hpp"
#include "posfet_core/estimation/lower_bound_monitor.hpp"
#include "posfet_core/estimation/process_noise.hpp"
#include "posfet_core/estimation/propagation.hpp"
#include "posfet_core/estimation/release_detector.hpp"
#include "posfet_core/estimation/rest_detector.hpp"
#include "posfet_core/estimation/rest_noise.hpp"
#include "posfet_core/estimation/sensor_readings.hpp"
#include "posfet_core/estimation/steady_force.hpp"
#include "posfet_core/estimation/total_certainty.hpp"
#include "posfet_core/estimation/touch_response.hpp"
#include "posfet_core/estimation/touched_forces.hpp"
#include "posfet_core/estimation/unexplained_residuals.hpp"
#include "posfet_core/estimation/unheated_belief.hpp"
#include "posfet_core/estimation/uniform_change.hpp"
#include "posfet_core/estimation/unseen_release.hpp"
#include "posfet_core/estimation/witnesses.hpp"
#include "posfet_core/estimation/zero_refutation.hpp"
#include "posfet_core/flags.hpp"
#include "posfet_core/force_integration.hpp"
#include "posfet_core/grid.hpp"

namespace posfet {

/// No force is valid for this long after an interruption [s].
constexpr double kResumeTime = 0.04;

/// Standard deviation of the total force, over that force, above which the forces are not valid [1]: fit for control of
/// a grip.
constexpr double kMaxRelativeUncertainty = 0.2;

/// Force of every taxel with its covariance, block by block; arrays row by row, [taxels].
///
/// The integration takes each scan; call `start` with the first one, and `close_block` whenever `block_time` has
/// reached `kBlock`. The force at the start is assumed to be zero: a taxel that is loaded then reads zero, a
/// negative force once the load is released, and zero soon after.
class ForceEstimator {
public:
  /// Throws std::invalid_argument where the array is none, or values are missing.
  explicit ForceEstimator(GivenArray array);

  ~ForceEstimator() = default;
  ForceEstimator(const ForceEstimator&) = delete;
  ForceEstimator& operator=(const ForceEstimator&) = delete;
  ForceEstimator(ForceEstimator&&) = delete;
  ForceEstimator& operator=(ForceEstimator&&) = delete;

  std::size_t taxels() const { return array_.taxels(); }

  /// What happens in every scan, and the state that it changes.
  const std::shared_ptr<ForceIntegration>& integration() const { return integration_; }

  /// Duration of the current block so far [s].
  double block_time() const { return integration_->block().elapsed; }

  /// Whether the forces of all taxels are valid.
  bool valid() const { return integration_->block().valid; }

  /// Estimated force [N], positive when pushed; valid where `offset_known`.
  const std::vector<double>& force() const { return state_.force; }
  const TaxelFlags& offset_known() const { return state_.offset_known; }

  /// Faulty taxels, whose offsets `valid` does not depend on. Set by `ignore`.
  const TaxelFlags& ignored() const { return state_.ignored; }

  /// Faulty taxels that count in sums of forces by their own readings. Set by the caller.
  TaxelFlags& informative() { return informative_; }

  /// Number of restarts of taxels whose signal was consistent with no force.
  std::size_t restarts() const { return restarts_; }

  /// Number of times that the last blocks were processed again.
  std::size_t processed_again() const { return processed_again_; }

  /// Means and covariance of the force errors.
  const std::shared_ptr<Belief>& belief() const { return filter_.belief(); }

  /// Start with a scan of these charge densities [C/m2], which has no predecessor.
  void start(const double* charge);

  /// Record that an unknown time passes before the next scan: changes of the force in it are unknown. Offsets stay
  /// known. At the next scan the force is set to the remaining charge, a lower bound of the force.
  void interrupt();

  /// Forget all, as if the next scan were the first one: what was known is wrong.
  void forget();

  /// Time that has been processed [s].
  double age() const { return integration_->block().age; }

  /// Process the block that is due: the taxels in contact at any time of it, and those of each contact. Has no effect
  /// where the offset is unknown: there a constant force is as informative as no force. A filter that diverged starts
  /// over, with all offsets unknown, and counts in `restarts`.
  void close_block(const bool* in_contact, const Vector<const Taxels*>& contacts);

  /// Set the faulty taxels; one that works again restarts with an unknown offset.
  void ignore(const bool* faulty);

  /// Set the variance of a reading of each taxel [N2]; initially that of the description.
  void set_noise_variance(const double* variance);

  /// Find the mean of `force` over the block that is due [N].
  void block_mean(double* out) const;

  /// Find the charge at each gate, as the force that would generate it [N].
  void residual_charge(double* out) const;

  /// Find the variance of each force that it does not share with others [N2].
  void force_variance(double* out) const;

  /// Find the variance that each force would have without a touch [N2]: without leaked charge, creep and warmth.
  void variance(double* out) const;

  /// Find that variance without what steps of the signals may have added since a touch began [N2]: neighbours that feel
  /// nothing contradict such a signal, too.
  void steady_variance(double* out) const;

  /// Set the forces to zero, and start a new block; offsets stay, as they are estimated all the time. `forced`: forces
  /// may be applied; those of the newest scan are set to zero, and none remains a lower bound. Otherwise the mean
  /// forces of the last block are set to zero, which have less noise. The correction that was added to each force is
  /// written into `change` [N]; 0 for ignored taxels.
  void tare(bool forced, double* change);

  /// Standard deviation of the total force over that force, above which the forces are not valid [1]; while the force
  /// falls, over its greatest value of the last eight blocks. May change.
  double max_relative_uncertainty = kMaxRelativeUncertainty;

  /// Whether something may touch the array when it starts: forces are not valid until a release or a forced tare shows
  /// what no force is; may change.
  bool touch_at_start = false;

private:
  // What the estimates say (force_estimator.cpp).
  double offset(std::size_t taxel) const;
  /// Whether the reading of a taxel is a force: not of a faulty one, unless it still counts in sums.
  bool counts(std::size_t taxel) const { return !ignored()[taxel] || informative_[taxel]; }
  bool has_rested(double longer = 0.0) const;

  // From one block to the next (force_estimator.cpp).
  void start_block();
  void estimate(const bool* in_contact, const Vector<const Taxels*>& contacts);
  bool is_refuted(Block& block);
  void restart(const TaxelFlags& where);
  void restart_errors(std::size_t taxel, const double* response);
  void go_back_half(const TaxelFlags& where);
  void forget_touch();
  void forget_contacts();
  void forget_blocks();

  // What a block shows (force_estimator_block.cpp).
  void measure(Block& block);
  void measure_process_noise(Block& block);
  void observe_noise(const Block& block);
  void observe_lone_drift(const Block& block);

  // A step of the filter (force_estimator_update.cpp).
  void process_again(const TaxelFlags& touched);
  void step(std::size_t index);
  void measure_zeros(std::size_t index);
  void find_slow_touches(const Block& block, Zeros& zeros);
  void measure_alone(const Block& block, const Zeros& zeros);
  void judge(Block& block, Zeros& zeros);
  void restart_or_correct(Block& block, TaxelFlags& odd);

  // Temperature, or a press (force_estimator_temperature.cpp).
  double unnoticed_change();
  bool follow_witnesses(Block& block);
  void explain_by_temperature(std::size_t index, Zeros& zeros);
  void take_unheated(Block& block, Zeros& zeros);

  // Where something touches, and where it has ended (force_estimator_touch.cpp).
  void find_touched(Block& block);
  Taxels find_unreleased(TaxelFlags& listed) const;
  TaxelFlags find_released(const TaxelFlags& odd, TaxelFlags& errors);
  void reset_released(const Block& block, const TaxelFlags& released);
  void set_to_zero(const Block& block, const TaxelFlags& where);
  void release(Block& block, const Vector<const Taxels*>& contacts);
  bool find_ended(const Block& block, const Vector<const Taxels*>& contacts, TaxelFlags& ended, TaxelFlags& left);
  void end_unknown_touch(const Block& block);

  // What follows for the forces (force_estimator_outcome.cpp).
  bool film_hides(const Belief& b) const;
  void follow_absorbed(const Block& block, double film_rate);
  void finish(const Block& block);
  void find_hot_touch();
  bool is_valid(double duration);
  void confirm_offsets(double duration);
  void prepare_compensation(const Block& block);

  // What all parts refer to.
  const EstimatedArray array_;
  const ContactSurroundings surroundings_;
  std::shared_ptr<ForceIntegration> integration_;
  ForceIntegration::State& state_;  ///< Of the integration.
  UniformChange uniform_;

  // The belief, and what changes it.
  ForceErrorFilter filter_;
  Propagation propagation_;
  BlockResiduals residuals_;
  SensorReadings readings_;
  RestNoise rest_noise_;
  SteadyForce steady_force_;
  LoneDrift lone_drift_;

  // Touches, and what they leave.
  TouchedForces touched_forces_;
  TouchResponse touch_;
  UnseenRelease unseen_;
  ProcessNoise process_noise_;
  HotFilm hot_film_;
  HiddenTouch hidden_touch_;

  // Doubts.
  UnheatedBelief unheated_;  ///< While `uniform_` is open.
  UnexplainedResiduals unexplained_;
  ReleaseDetector release_;
  RestDetector rest_;
  LowerBoundMonitor lower_bound_;
  ZeroRefutation refutation_;
  LastBlocks blocks_;
  Witnesses witnesses_;

  // What is reported.
  AbsorbedForce absorbed_;
  ForceCovariance covariance_;
  TotalCertainty certainty_;

  std::size_t restarts_ = 0;
  std::size_t processed_again_ = 0;
  bool zero_known_ = false;             ///< Whether a release or a forced tare has shown what no force is.
  double recovering_ = 0.0;             ///< Time until forces may be valid after an interruption [s].
  double rested_ = 0.0;                 ///< Time since a contact was listed, or an unknown one left [s].
  double last_duration_ = kBlock;       ///< Duration of the last block [s].
  double refuted_ = 0.0;                ///< By how much sensors contradict the zeros of the newest block [K]: something
                                        ///< wide presses.
  double unconfirmed_ = 0.0;            ///< Temperature that the hypothesis claims beyond what the sensors show [K].
  std::vector<double> left_charge_;     ///< Deviation of what is left where an offset is unknown, as a force [N].
  std::vector<double> noise_variance_;  ///< Variance of a reading [N2].
  std::vector<double> leaked_;          ///< Force less signal at the end of the last block [N].
  std::vector<double> mean_;            ///< Mean force of the last block [N].
  std::vector<double> last_mean_;       ///< The one before, while a touch is unknown [N]; NaN: none.
  TaxelFlags informative_;
  TaxelFlags listed_;   ///< Taxels in contact in the last block.
  TaxelFlags touched_;  ///< These, and those whose residual was unexplained.
  TaxelFlags beside_;   ///< These, and their neighbours.
};

}  // namespace posfet
