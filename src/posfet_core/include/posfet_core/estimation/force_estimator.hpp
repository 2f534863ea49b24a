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

#include <array>
#include <cstddef>
#include <memory>
#include <vector>

#include "posfet_core/estimation/absorbed_force.hpp"
#include "posfet_core/estimation/block.hpp"
#include "posfet_core/estimation/contact_surroundings.hpp"
#include "posfet_core/estimation/error_states.hpp"
#include "posfet_core/estimation/force_error_filter.hpp"
#include "posfet_core/estimation/held_forces.hpp"
#include "posfet_core/estimation/hidden_force.hpp"
#include "posfet_core/estimation/hot_film.hpp"
#include "posfet_core/estimation/lone_drift.hpp"
#include "posfet_core/estimation/lower_bound_monitor.hpp"
#include "posfet_core/estimation/moved_share.hpp"
#include "posfet_core/estimation/object_heating.hpp"
#include "posfet_core/estimation/release_detector.hpp"
#include "posfet_core/estimation/rest_detector.hpp"
#include "posfet_core/estimation/rest_noise.hpp"
#include "posfet_core/estimation/sensor_readings.hpp"
#include "posfet_core/estimation/steady_force.hpp"
#include "posfet_core/estimation/thermal_contact.hpp"
#include "posfet_core/estimation/total_certainty.hpp"
#include "posfet_core/estimation/touch_response.hpp"
#include "posfet_core/estimation/unexplained_residuals.hpp"
#include "posfet_core/estimation/uniform_change.hpp"
#include "posfet_core/estimation/witnesses.hpp"
#include "posfet_core/estimation/zero_refutation.hpp"
#include "posfet_core/force_integration.hpp"
#include "posfet_core/grid.hpp"

namespace posfet {

/// No force is valid for this long after an interruption [s].
constexpr double kResumeTime = 0.04;

/// Standard deviation of the total force, over that force, above which the forces are not valid [1]: fit for control of
/// a grip.
constexpr double kMaxRelativeUncertainty = 0.2;

/// What description and calibration say of an array; vectors have one value for each taxel.
struct EstimatedArray {
  Layout layout;
  std::vector<double> time_constant;      ///< Of the leakage [s].
  std::vector<double> newton_per_charge;  ///< Force per charge density [N m2/C].
  std::vector<double> newton_per_kelvin;  ///< Pyroelectric signal [N/K].
  std::vector<double> gain_deviation;     ///< Relative standard deviation of the gain [1],
  double common_gain_deviation;           ///< and of what all taxels have in common [1].
  std::vector<double> leak_deviation;     ///< Relative standard deviation of the leak rate [1].
  LeakTemperature leak_temperature;       ///< How it depends on the temperature.
  double noise;                           ///< Standard deviation of a reading [N].
  double threshold;                       ///< Contact threshold [N].
  double greatest_force;                  ///< Greatest force of a taxel [N].
  double left_charge;                     ///< Charge left by an earlier force at the start, as a force [N].
  double film_lag;                        ///< Time constant of the film's lag behind the chip [s], >= 0.
};

/// Force of every taxel with its covariance, block by block; arrays row by row, [taxels].
///
/// The integration takes each scan; call `start` with the first one, and `close_block` whenever `block_time` has
/// reached `kBlock`. The force at the start is assumed to be zero: a taxel that is loaded then reads zero, a
/// negative force once the load is released, and zero soon after.
class ForceEstimator {
public:
  /// Throws std::invalid_argument where the array is none, or values are missing.
  ForceEstimator(EstimatedArray array, ErrorPriors priors);

  ~ForceEstimator() = default;
  ForceEstimator(const ForceEstimator&) = delete;
  ForceEstimator& operator=(const ForceEstimator&) = delete;
  ForceEstimator(ForceEstimator&&) = delete;
  ForceEstimator& operator=(ForceEstimator&&) = delete;

  std::size_t taxels() const { return array_.time_constant.size(); }

  /// What happens in every scan, and the state that it changes.
  const std::shared_ptr<ForceIntegration>& integration() const { return integration_; }

  /// Duration of the current block so far [s].
  double block_time() const { return integration_->block().elapsed; }

  /// Whether the forces of all taxels are valid.
  bool valid() const { return integration_->block().valid; }

  /// Estimated force [N], positive when pushed; valid where `offset_known`.
  const std::vector<double>& force() const { return state().force; }
  const TaxelFlags& offset_known() const { return state().offset_known; }

  /// Faulty taxels, whose offsets `valid` does not depend on. Set by `ignore`.
  const TaxelFlags& ignored() const { return state().ignored; }

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
  /// What a reading of the sensors differs from its expectation by.
  struct Contradiction {
    double kelvin;      ///< Reading less expectation, after all that explains it [K].
    double deviations;  ///< Size of that in its deviations [1].
    double square;      ///< Square of that in its variance, before anything explains it [1],
    double spread;      ///< and the logarithm of that variance [1].
  };

  // What the estimates say.
  ForceIntegration::State& state() { return integration_->state(); }
  const ForceIntegration::State& state() const { return integration_->state(); }
  double signal(std::size_t taxel) const;
  double offset(std::size_t taxel) const;
  double leak() const { return integration_->block().leak; }
  /// Mean signal of a change of the film's temperature [N/K], and that change which makes no difference to the forces
  /// [K].
  double mean_per_kelvin() const { return integration_->mean_newton_per_kelvin(); }
  double negligible() const { return integration_->limits().negligible; }
  double present_time_constant(std::size_t taxel) const { return array_.time_constant[taxel] / leak(); }
  double warmth_difference() const;
  double warmth_variance(std::size_t taxel) const;
  double whole_variance(std::size_t taxel) const;
  double tail_spread(const Belief& belief) const;
  double film_rate() const;
  std::size_t usable() const;
  /// Whether the reading of a taxel is a force: not of a faulty one, unless it still counts in sums.
  bool counts(std::size_t taxel) const { return !ignored()[taxel] || informative_[taxel]; }
  bool has_rested(double longer = 0.0) const;

  // From one block to the next (force_estimator.cpp).
  void start_block();
  void estimate(const bool* in_contact, const Vector<const Taxels*>& contacts);
  bool is_refuted(Block& block);
  void restart(const TaxelFlags& where);
  void start_over();
  void forget_touch();
  void forget_contacts();
  void forget_blocks();

  // What a block shows (force_estimator_block.cpp).
  void measure(Block& block);
  void find_tails(Block& block);
  static TouchResponse::Known known_errors(const Belief& belief, const Block& block);
  void measure_touch(Block& block);
  double hidden_share() const;
  void add_held_forces(const std::vector<double>& force, std::vector<double>& least, double duration);
  void follow_thermal_contact(double duration);
  void measure_process_noise(Block& block);
  double clipped_noise(std::size_t taxel);
  double unseen_creep() const;
  void add_signal_noise(Block& block);
  void add_warmth_noise(Block& block);
  void add_touch_noise(Block& block, const std::vector<double>& pressing);
  void add_unknown_warmth(Block& block) const;
  void observe_noise(const Block& block);
  void admit_walk(double known);
  void observe_steady_force();
  void observe_lone_drift(const Block& block);
  void admit_step(const LoneDrift::Drift& found);

  // A step of the filter (force_estimator_update.cpp).
  void process_again(const TaxelFlags& touched);
  void step(std::size_t index);
  void predict(ForceErrorFilter& filter, const Block& block);
  void measure_zeros(std::size_t index);
  void expect_small_forces(const Block& block);
  void find_residuals();
  void admit_warmer_object();
  void find_slow_touches(const Block& block);
  void measure_alone(const Block& block);
  bool is_zero_faulty(const Block& block, std::size_t taxel) const;
  bool recovers_unseen(std::size_t taxel) const;
  double recovery_left() const;
  void judge(Block& block);
  void restart_or_correct(Block& block);

  // Temperature, or a press (force_estimator_temperature.cpp).
  Contradiction measure_temperature(ForceErrorFilter& filter, const Block& block, bool zeros);
  bool was_misled();
  double unnoticed_change();
  bool may_tell() const;
  void follow_witnesses(const Block& block);
  bool take_witness(Block& block);
  void explain_by_temperature(std::size_t index);
  void open_hypothesis();
  void drop_hypothesis();
  void follow_unheated(const Block& block);
  UniformChange::Evidence evidence_of(const Block& block);
  void take_unheated(Block& block);

  // Where something touches, and where it has ended (force_estimator_touch.cpp).
  void find_touched(Block& block);
  bool is_whole(const TaxelFlags& touched) const;
  void touch_all(Block& block) const;
  double pressed_force() const;
  bool find_unreleased(TaxelFlags& listed, Taxels& lost);
  void find_released();
  void find_hot_film();
  void reset_released(const Block& block);
  void release(Block& block, const Vector<const Taxels*>& contacts);
  bool find_left(const Vector<const Taxels*>& contacts);
  bool drop_shown(const std::vector<double>& variance);
  void end_unknown_touch(const Block& block);

  // What follows for the forces (force_estimator_outcome.cpp).
  void finish(const Block& block);
  void find_absorbed();
  void set_covariance(const Block& block);
  bool is_valid(double duration);
  void find_hot_touch();
  bool may_be_hot() const;
  double object_deviation(std::size_t taxel) const;
  double total_deviation(const TaxelFlags& counted) const;
  bool is_certain(const TaxelFlags& counted, double deviation) const;
  void confirm_offsets(double duration);
  void prepare_compensation(const Block& block);

  EstimatedArray array_;
  ErrorPriors priors_;
  std::shared_ptr<ForceIntegration> integration_;
  SharedDynamics dynamics_;
  ForceErrorFilter filter_;
  ForceErrorFilter unheated_;  ///< Without the hypothesis of `uniform_`, while that is open.
  TouchResponse touch_;
  TouchResponse unheated_touch_;  ///< Of the touch that there is without the hypothesis.
  UniformChange uniform_;
  UnexplainedResiduals unexplained_;
  ReleaseDetector release_;
  RestNoise rest_noise_;
  SteadyForce steady_force_;
  HeldForces held_forces_;
  LoneDrift lone_drift_;
  ThermalContact thermal_contact_;
  ObjectHeating heating_;
  ZeroRefutation refutation_;
  RestDetector rest_;
  LowerBoundMonitor lower_bound_;
  ContactSurroundings surroundings_;
  SensorReadings readings_;
  AbsorbedForce absorbed_;
  HiddenForce hidden_;
  HotFilm hot_film_;
  MovedShare moved_share_;
  TotalCertainty certainty_;
  LastBlocks blocks_;
  Witnesses witnesses_;
  Block passed_;  ///< Place of what has passed since a witness was called.

  TaxelFlags informative_;
  std::size_t restarts_ = 0;
  std::size_t processed_again_ = 0;
  double recovering_ = 0.0;                ///< Time until forces may be valid after an interruption [s].
  double rested_ = 0.0;                    ///< Time since a contact was listed, or an unknown one left [s].
  double last_duration_ = kBlock;          ///< Duration of the last block [s].
  std::vector<double> unheated_response_;  ///< Responses of the force errors without the hypothesis, [taxels, states].
  double farthest_ = 0.0;                  ///< Greatest difference from the temperature of the calibration [K].
  double expected_film_ = 0.0;             ///< Temperature of the film without any change of its rate [K],
  double expected_rate_ = 0.0;             ///< which is this one [K/s].
  double refuted_ = 0.0;  ///< By how much sensors contradict the zeros of the newest block [K]: something wide presses.
  double unconfirmed_ = 0.0;  ///< Temperature that the hypothesis claims beyond what the sensors show [K].

  std::vector<double> left_deviation_;      ///< Deviation of the charge that is left where an offset is unknown [N].
  std::vector<double> noise_variance_;      ///< Variance of a reading [N2].
  std::vector<double> leaked_;              ///< Force less signal at the end of the last block [N].
  std::vector<double> mean_;                ///< Mean force of the last block [N].
  std::vector<double> last_mean_;           ///< The one before, while a touch is unknown [N]; NaN: none.
  std::vector<double> steady_;              ///< Force that follows the mean with a play: noise is no motion [N].
  std::vector<double> stepped_;             ///< Variance by steps of the signal since a touch began [N2].
  std::vector<double> left_force_;          ///< Force that left unseen, as the film had to recover from it then [N],
  double unseen_for_ = 0.0;                 ///< and the time since then [s].
  bool zero_known_ = false;                 ///< Whether a release or a forced tare has shown what no force is.
  std::vector<double> touch_force_;         ///< Touched force of the last block [N].
  std::vector<double> tail_;                ///< Its small forces beside a contact, if they declined geometrically [N].
  std::vector<double> warmth_;              ///< Greatest relative warmth of the taxels [1].
  std::vector<double> warmed_;              ///< Variance of the warmth of each taxel about the common one [N2].
  std::vector<double> own_;                 ///< Variance of each force that it does not share [N2].
  std::vector<double> untouched_variance_;  ///< The variance that it would have without a touch [N2].
  TaxelFlags listed_;                       ///< Taxels in contact in the last block.
  TaxelFlags touched_;                      ///< These, and those whose residual was unexplained.
  TaxelFlags beside_;                       ///< These, and their neighbours.

  // Work space of a step of the filter.
  TaxelFlags small_;                   ///< Taxels beside a contact, with a small force.
  TaxelFlags judged_;                  ///< Taxels whose residual counts.
  TaxelFlags zeros_;                   ///< Taxels whose force is known.
  TaxelFlags odd_;                     ///< Taxels whose residual is unexplained.
  TaxelFlags left_;                    ///< Taxels of contacts whose film cools.
  TaxelFlags chosen_;                  ///< Any others.
  std::vector<double> measured_;       ///< [N].
  std::vector<double> response_;       ///< [taxels, states].
  std::vector<double> noise_;          ///< [N2].
  std::vector<double> residual_;       ///< [N].
  std::vector<double> sensitivity_;    ///< [taxels, states].
  std::vector<double> deviation_;      ///< Of the residuals [N].
  std::vector<double> own_deviation_;  ///< Of what they do not share [N].
  std::vector<double> own_noise_;      ///< [taxels, own, own].
  std::vector<double> leaked_share_;   ///< [1].
  std::vector<double> driven_;         ///< [taxels, states].
  std::vector<double> values_;         ///< Any, [taxels].
};

}  // namespace posfet
