// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/force_estimator.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <stdexcept>
#include <utility>
#include <vector>

#include "force_estimator_constants.hpp"
#include "posfet_core/numbers.hpp"
#include "posfet_core/product.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

namespace {

/// h/tau above which the time of a force change within a step matters [1].
constexpr double kLongStep = 0.05;

/// Standard uncertainty of an offset that was known when its taxel restarted [contact threshold].
constexpr double kRestartDeviation = 0.1;

/// Greatest deviation of an untouched taxel's offset from the median offset [contact threshold]; a larger one requires
/// a longer rest.
constexpr double kOffsetSpread = 2.0;

/// Time after which a force without which an object released counts as none after an interruption [s].
constexpr double kLostForceTime = 2.0;

/// By how much the film may answer more to a force within a block than to one that lasts, in sizes of its fastest slow
/// response [1]: this is by about as many of their time constants faster, of which a calibration sees nothing; assumed.
constexpr double kBrief = 2.0;

/// Share of the contact threshold that a taxel must read before a scan is tested for a uniform change [1].
constexpr double kNoticeable = 0.3;

/// Change of the film's temperature that makes no difference to the forces [K].
double negligible_change(const EstimatedArray& array) {
  double whole = 0.0;
  for (const double response : array.newton_per_kelvin) {
    whole += std::abs(response);
  }
  return whole > 0.0 ? array.threshold / whole : std::numeric_limits<double>::infinity();
}

std::shared_ptr<ForceIntegration> make_integration(const EstimatedArray& array) {
  const double fastest = *std::min_element(array.time_constant.begin(), array.time_constant.end());
  const IntegrationLimits limits{kLongStep * fastest, array.threshold, kNoticeable * array.threshold, kFastestWarming,
                                 negligible_change(array)};
  return std::make_shared<ForceIntegration>(array.time_constant, array.newton_per_charge, array.newton_per_kelvin,
                                            array.leak_temperature, limits, kCauses);
}

std::shared_ptr<Belief> make_belief(std::size_t taxels, const ErrorPriors& priors) {
  auto belief = std::make_shared<Belief>(taxels, kSharedStates);
  belief->shared = priors.mean();
  belief->set_covariance(priors.covariance());
  return belief;
}

}  // namespace

ForceEstimator::ForceEstimator(GivenArray array)
    : array_(std::move(array)),
      surroundings_(Grid(array_.layout)),
      integration_(make_integration(array_)),
      state_(integration_->state()),
      uniform_(array_.newton_per_kelvin, array_.priors.pyroelectric),
      filter_(make_belief(taxels(), array_.priors)),
      propagation_(array_, uniform_.observable()),
      residuals_(array_),
      readings_(array_.priors.reading),
      rest_noise_(array_),
      lone_drift_(taxels()),
      touched_forces_(array_, surroundings_),
      touch_(array_),
      unseen_(taxels(), array_.priors),
      process_noise_(array_, surroundings_),
      hot_film_(array_, surroundings_),
      hidden_touch_(array_),
      unheated_(touch_),
      unexplained_(taxels(), array_.threshold),
      release_(taxels()),
      rest_(taxels(), array_.noise, kOffsetSpread * array_.threshold,
            *std::max_element(array_.time_constant.begin(), array_.time_constant.end())),
      lower_bound_(taxels(), array_.threshold, UnexplainedResiduals::kNegativeTime, kLostForceTime),
      blocks_(taxels(), touch_),
      witnesses_(taxels(), touch_),
      absorbed_(array_, uniform_.observable()),
      covariance_(array_, surroundings_, state_),
      certainty_(array_.threshold),
      left_charge_(taxels(), array_.left_charge),
      noise_variance_(taxels(), square(array_.noise)),
      leaked_(taxels(), 0.0),
      mean_(taxels(), 0.0),
      last_mean_(taxels(), 0.0),
      informative_(taxels()),
      listed_(taxels()),
      touched_(taxels()),
      beside_(taxels()) {
  const double fastest = std::hypot(array_.priors.creep_mean[0], array_.priors.creep[0]);
  state_.rise_deviation = std::hypot(array_.common_gain_deviation, kBrief * fastest);
  start_block();
}

// What the estimates say.

/// Offset of a signal [N], with what all have in common.
double ForceEstimator::offset(std::size_t taxel) const {
  return offset_of(*belief(), taxel, array_.time_constant[taxel]);
}

/// Whether the last contact ended before the stored blocks, and by so much time [s] `longer` ago. Half a block is
/// allowed for, as times are sums.
bool ForceEstimator::has_rested(double longer) const {
  return rested_ >= LastBlocks::kLag * kBlock + longer && rested_ + 0.5 * kBlock >= blocks_.duration() + longer;
}

void ForceEstimator::block_mean(double* out) const {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    out[taxel] = state_.sum[taxel] / integration_->block().scans;
  }
}

void ForceEstimator::residual_charge(double* out) const {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    out[taxel] = integration_->signal(taxel) - offset(taxel);
  }
}

void ForceEstimator::force_variance(double* out) const {
  std::transform(noise_variance_.begin(), noise_variance_.end(), covariance_.own().begin(), out, std::plus<>());
}

void ForceEstimator::variance(double* out) const {
  std::transform(noise_variance_.begin(), noise_variance_.end(), covariance_.untouched().begin(), out, std::plus<>());
}

void ForceEstimator::steady_variance(double* out) const {
  variance(out);
  const double warmth = belief()->shared[kWarmth];
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double relative = touched_[taxel] ? 0.0 : touch_.warm()[taxel] + touch_.range()[taxel];
    out[taxel] = std::max(out[taxel] - process_noise_.stepped()[taxel], noise_variance_[taxel]) +
                 square(array_.newton_per_kelvin[taxel] * warmth * relative);
  }
}

// What the caller changes.

void ForceEstimator::ignore(const bool* faulty) {
  TaxelFlags back(taxels());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    back[taxel] = ignored()[taxel] && !faulty[taxel];
  }
  state_.ignored.set(faulty);
  restart(back);
}

void ForceEstimator::set_noise_variance(const double* variance) {
  std::copy(variance, variance + taxels(), noise_variance_.begin());
}

void ForceEstimator::interrupt() {
  integration_->block().started = integration_->block().valid = false;
  recovering_ = kResumeTime;
}

void ForceEstimator::tare(bool forced, double* change) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    change[taxel] = ignored()[taxel] ? 0.0 : -(forced ? force()[taxel] : mean_[taxel]);
    belief()->error_of(taxel)[kForceError] -= change[taxel];
    belief()->own_of(taxel)[own_at(kForceError, kForceError)] += noise_variance_[taxel];
    state_.correction[taxel] -= change[taxel];
    state_.force[taxel] += change[taxel];
    state_.held[taxel] += change[taxel];
    absorbed_.shift(taxel, -change[taxel]);
    mean_[taxel] += change[taxel];
    leaked_[taxel] = state_.raw[taxel] - integration_->signal(taxel);
  }
  forget_blocks();
  uniform_.close();  // what the other belief would say no longer matters
  unconfirmed_ = 0.0;
  if (forced) {
    zero_known_ = true;
    unexplained_.reset();
    forget_touch();
    forget_contacts();
    integration_->watch_none();
    std::fill(state_.clipped.begin(), state_.clipped.end(), 0.0);
  }
  start_block();
}

/// Forget where something touches.
void ForceEstimator::forget_contacts() {
  lower_bound_.clear();
  refutation_.clear();
  for (TaxelFlags* mask : {&listed_, &touched_, &beside_}) {
    mask->fill(false);
  }
}

/// Forget the touch, after which no force is zero, and what touches told: the force was another one. What it warmed
/// cools.
void ForceEstimator::forget_touch() {
  Belief& b = *belief();
  const std::vector<double> mean = array_.priors.mean();
  const SquareMatrix prior = array_.priors.covariance();
  hot_film_.forget();
  hidden_touch_.forget();
  touched_forces_.forget_contact();
  Vector<double> response(taxels() * kSharedStates);
  touch_.matrix(response.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double* row = response.data() + taxel * kSharedStates;
    const double shown = b.error_of(taxel)[kForceError] + dot(row, b.shared.data(), kSharedStates);
    std::array<double, kSharedStates> left{};
    left[kFilm] = row[kFilm];
    b.reset_force_error(taxel, shown + touch_.loops()[taxel], left.data(), noise_variance_[taxel]);
  }
  for (std::size_t state = 0; state < kSharedStates; ++state) {
    if (!is_of_touch(state)) {
      continue;
    }
    b.restart(state, mean[state], prior[state * kSharedStates + state]);
    for (std::size_t taxel = 0; taxel < taxels() && (state == kWarmth || state == kWeakWarmth); ++taxel) {
      const double warmth = response[taxel * kSharedStates + state];
      b.slope_of(taxel, kOwnWarmth)[state] = warmth;
      b.error_of(taxel)[kOwnWarmth] += warmth * mean[state];
    }
  }
  touch_.reset();
}

// Start and restart.

void ForceEstimator::start(const double* charge) {
  integration_->inverse().start(charge);
  last_duration_ = kBlock;
  Belief& b = *belief();
  if (const double sensors = integration_->block().sensors; !std::isnan(sensors)) {
    readings_.start(integration_->block());  // it says what these temperatures are, and nothing else
    std::vector<double> mean = array_.priors.mean();
    SquareMatrix covariance = array_.priors.covariance();
    mean[kEarlier] = b.shared[kEarlier];
    covariance[kEarlier * kSharedStates + kEarlier] = b.variance(kEarlier);
    filter_.restart_temperature(sensors, mean.data(), covariance.data());
  }
  Vector<double> before(taxels());
  Vector<double> remaining(taxels());
  Vector<double> response(taxels() * kSharedStates);
  touch_.matrix(response.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    leaked_[taxel] = state_.raw[taxel] - integration_->signal(taxel);
    const double left = state_.offset_known[taxel] ? integration_->signal(taxel) - offset(taxel) : 0.0;
    before[taxel] = state_.ignored[taxel] ? 0.0 : state_.force[taxel];
    remaining[taxel] = state_.ignored[taxel] ? 0.0 : left;
    state_.held[taxel] = state_.force[taxel] = std::max(left, 0.0);
    state_.correction[taxel] = state_.raw[taxel] - state_.force[taxel];
    state_.clipped[taxel] = 0.0;
    b.reset_force_error(taxel, state_.correction[taxel] - touch_.loops()[taxel],
                        response.data() + taxel * kSharedStates,
                        noise_variance_[taxel] + b.own_of(taxel)[own_at(kOffset, kOffset)]);
  }
  lower_bound_.start(before.data(), remaining.data());
  std::fill(last_mean_.begin(), last_mean_.end(), kUnknown);
  hot_film_.interrupt();
  go_back_half(TaxelFlags(taxels(), true));
  Vector<double> signals(taxels());
  TaxelFlags unknown(taxels());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    absorbed_.restart(taxel, b);
    signals[taxel] = integration_->signal(taxel);
    unknown[taxel] = !state_.offset_known[taxel];
  }
  forget_blocks();
  uniform_.close();
  unconfirmed_ = 0.0;
  certainty_.start();
  unexplained_.reset();
  release_.restart();
  touched_forces_.forget_contact();
  integration_->block().started = true;
  rest_.start(signals.data());
  integration_->watch_none();
  restart(unknown);
  start_block();
}

void ForceEstimator::forget() {
  rested_ = 0.0;
  zero_known_ = false;
  unseen_.forget();
  process_noise_.forget();
  left_charge_.assign(taxels(), array_.left_charge);
  unexplained_ = UnexplainedResiduals(taxels(), array_.threshold);
  hot_film_.forget();
  hidden_touch_.forget();
  *belief() = *make_belief(taxels(), array_.priors);
  touch_.reset();
  forget_contacts();
  state_.offset_known.fill(false);
  std::fill(state_.force.begin(), state_.force.end(), 0.0);
  integration_->block().started = integration_->block().valid = false;
}

/// Restart taxels: no force, and the signal is offset, or charge left by an earlier force: what it has beyond an offset
/// that was known. After each rejection the deviation of that charge is larger.
void ForceEstimator::restart(const TaxelFlags& where) {
  if (!where.any()) {
    return;
  }
  Vector<double> response(taxels() * kSharedStates);
  touch_.matrix(response.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (where[taxel]) {
      restart_errors(taxel, response.data() + taxel * kSharedStates);
    }
  }
  go_back_half(where);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (where[taxel]) {
      state_.rate[taxel] = offset(taxel) / integration_->time_constant(taxel);
      state_.offset_known[taxel] = false;
      state_.clipped[taxel] = 0.0;
      state_.correction[taxel] = state_.raw[taxel];
      state_.held[taxel] = state_.force[taxel] = 0.0;
      absorbed_.restart(taxel, *belief());
    }
  }
  forget_blocks();
}

/// Restart the errors of a taxel, with its present responses to the touch.
void ForceEstimator::restart_errors(std::size_t taxel, const double* response) {
  Belief& b = *belief();
  const double noise = noise_variance_[taxel];
  double* error = b.error_of(taxel);
  double* own = b.own_of(taxel);
  std::fill_n(b.slope_of(taxel, 0), kOwnStates * kSharedStates, 0.0);
  std::fill_n(own, kOwnStates * kOwnStates, 0.0);
  b.reset_force_error(taxel, state_.raw[taxel] - touch_.loops()[taxel], response, noise);
  error[kSmallForce] = error[kPyroelectric] = error[kOwnWarmth] = 0.0;
  own[own_at(kPyroelectric, kPyroelectric)] = square(array_.priors.pyroelectric);
  if (state_.offset_known[taxel]) {
    left_charge_[taxel] = array_.left_charge + std::abs(integration_->signal(taxel) - offset(taxel));
    own[own_at(kOffset, kOffset)] = square(kRestartDeviation * array_.threshold);
    return;
  }
  // The offset has the noise of the signal that it is set to; so has the force. A film that warms generates charge,
  // which is no offset: that of the present rate, as far as it has lasted.
  const double present = integration_->time_constant(taxel);
  const double charge =
      present * array_.newton_per_kelvin[taxel] * -std::expm1(-std::max(age() - array_.film_lag, 0.0) / present);
  error[kOffset] =
      integration_->signal(taxel) - array_.time_constant[taxel] * b.shared[kDrift] - charge * b.shared[kRate];
  b.slope_of(taxel, kOffset)[kRate] = -charge;
  own[own_at(kForceError, kOffset)] = own[own_at(kOffset, kForceError)] = noise;
  own[own_at(kOffset, kOffset)] = noise + square(left_charge_[taxel]);
}

/// Set the force errors of taxels, which are known now, to what they were in the middle of the last block.
void ForceEstimator::go_back_half(const TaxelFlags& where) {
  Vector<double> leaked(taxels());
  Vector<double> driven(taxels() * kSharedStates);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    double& drift = driven[taxel * kSharedStates + kDrift];
    leaked[taxel] = where[taxel] ? -0.5 * last_duration_ / integration_->time_constant(taxel) : 0.0;
    drift = where[taxel] ? -0.5 * last_duration_ * integration_->block().leak : 0.0;
  }
  belief()->integrate(leaked.data(), driven.data());
}

void ForceEstimator::start_block() {
  integration_->start_block(uniform_.may_open() && uniform_.observable() && !touched_.any());
}

// The end of a block.

void ForceEstimator::close_block(const bool* in_contact, const Vector<const Taxels*>& contacts) {
  try {
    estimate(in_contact, contacts);
  } catch (const std::domain_error&) {  // what the filter says is impossible
    restarts_ += state_.usable();
    forget();
    const std::vector<double> charge = integration_->inverse().charge();
    start(charge.data());
  }
}

/// Process the block that is due. Throws std::domain_error where the belief is none that can be.
void ForceEstimator::estimate(const bool* in_contact, const Vector<const Taxels*>& contacts) {
  Block& block = blocks_.next();
  block_mean(mean_.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    block.listed[taxel] = in_contact[taxel] && offset_known()[taxel];
  }
  Vector<const Taxels*> listed_contacts = contacts;
  const Taxels lost = find_unreleased(block.listed);
  if (!lost.empty()) {
    listed_contacts.push_back(&lost);
  }
  find_touched(block);
  measure(block);
  hot_film_.follow(block.touched.any(), block.duration);
  observe_noise(block);
  blocks_.push();
  if (uniform_.open()) {
    unheated_.follow(block, propagation_, ignored());
  }
  const bool again = is_refuted(block);
  if (again) {
    process_again(block.touched);
  }
  if (follow_witnesses(block) || again) {
    filter_.forces(block.mean.data(), block.response.data(), mean_.data());
  }
  listed_.set(block.listed.data());
  if (steady_force_.is_due(blocks_.full() && blocks_.newest().listed.any())) {
    TaxelFlags counted(taxels());
    for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
      counted[taxel] = !ignored()[taxel] && !lower_bound_.mask()[taxel];
    }
    steady_force_.update(filter_, blocks_, counted, array_.newton_per_kelvin);
  }
  observe_lone_drift(block);
  release(block, listed_contacts);
  if (lower_bound_.mask().any()) {
    end_unknown_touch(block);
  }
  touched_.set(block.touched.data());
  surroundings_.dilate(touched_, beside_);
  const bool possible = std::abs(belief()->shared[kFilm]) < kHottest;  // false for NaN
  if (!possible) {
    throw std::domain_error("no film survives this temperature");
  }
  finish(block);
}

/// Whether what has been made of the stored blocks is wrong: a touch has begun in the newest one, or the sensors refute
/// its zeros, by which it is processed here. All of its taxels are touched, then.
bool ForceEstimator::is_refuted(Block& block) {
  refuted_ = 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    // Beside a contact forces were small ones, and no zeros.
    const bool was_small = beside_[taxel] && listed_.any();
    if (block.touched[taxel] && !touched_[taxel] && !was_small) {
      return true;
    }
  }
  step(blocks_.size() - 1);
  if (refuted_ == 0.0 || blocks_.size() == 0) {
    return false;
  }
  block.touch_all(offset_known(), ignored());
  return true;
}

/// Forget what could be processed again, as that would undo what has been decided.
void ForceEstimator::forget_blocks() {
  blocks_.clear();
  witnesses_.clear();
  lone_drift_.restart();
}

}  // namespace posfet
