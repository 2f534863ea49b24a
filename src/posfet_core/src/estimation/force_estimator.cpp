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

/// Change of its temperature that no film survives [K]: a taxel whose response to it would not matter has none.
constexpr double kHottest = 1e3;

EstimatedArray checked(EstimatedArray array) {
  const auto taxels = static_cast<std::size_t>(Grid(array.layout).taxels());
  for (const auto* values : {&array.time_constant, &array.newton_per_charge, &array.newton_per_kelvin,
                             &array.gain_deviation, &array.leak_deviation}) {
    if (values->size() != taxels) {
      throw std::invalid_argument("all values must be given for each taxel");
    }
  }
  for (double& response : array.newton_per_kelvin) {
    const double greatest = static_cast<double>(taxels) * kHottest * std::abs(response);
    response = greatest < array.threshold ? 0.0 : response;
  }
  return array;
}

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

ForceEstimator::ForceEstimator(EstimatedArray array, ErrorPriors priors)
    : array_(checked(std::move(array))),
      priors_(std::move(priors)),
      integration_(make_integration(array_)),
      dynamics_(priors_, array_.film_lag),
      filter_(make_belief(taxels(), priors_)),
      unheated_(std::make_shared<Belief>(taxels(), kSharedStates)),
      touch_(array_.layout, array_.time_constant, array_.newton_per_kelvin, priors_),
      unheated_touch_(touch_),
      uniform_(array_.newton_per_kelvin, priors_.pyroelectric),
      unexplained_(taxels(), array_.threshold),
      release_(taxels()),
      rest_noise_(array_.time_constant, array_.newton_per_kelvin, priors_.film_walk, array_.film_lag),
      held_forces_(Grid(array_.layout)),
      lone_drift_(taxels()),
      thermal_contact_(taxels(), priors_.warmth_time, array_.threshold),
      rest_(taxels(), array_.noise, kOffsetSpread * array_.threshold,
            *std::max_element(array_.time_constant.begin(), array_.time_constant.end())),
      lower_bound_(taxels(), array_.threshold, UnexplainedResiduals::kNegativeTime, kLostForceTime),
      surroundings_(Grid(array_.layout)),
      readings_(priors_.reading),
      absorbed_(array_.time_constant, array_.newton_per_kelvin),
      hidden_(array_.newton_per_kelvin, priors_),
      hot_film_(taxels(), priors_.warmth_time),
      moved_share_(taxels()),
      certainty_(array_.threshold),
      blocks_(taxels(), touch_),
      witnesses_(taxels()),
      passed_(taxels(), touch_),
      left_deviation_(taxels(), array_.left_charge),
      noise_variance_(taxels(), square(array_.noise)) {
  for (auto* values : {&leaked_, &mean_, &last_mean_, &steady_, &stepped_, &left_force_, &tail_, &touch_force_,
                       &warmed_, &warmth_, &own_, &measured_, &noise_, &residual_, &untouched_variance_, &deviation_,
                       &own_deviation_, &leaked_share_, &values_}) {
    values->assign(taxels(), 0.0);
  }
  for (auto* values : {&response_, &unheated_response_, &sensitivity_, &driven_}) {
    values->assign(taxels() * kSharedStates, 0.0);
  }
  const double fastest = std::hypot(priors_.creep_mean[0], priors_.creep[0]);
  state().rise_deviation = std::hypot(array_.common_gain_deviation, kBrief * fastest);
  own_noise_.assign(taxels() * kOwnStates * kOwnStates, 0.0);
  for (auto* mask :
       {&informative_, &listed_, &touched_, &beside_, &small_, &judged_, &zeros_, &odd_, &left_, &chosen_}) {
    *mask = TaxelFlags(taxels());
  }
  start_block();
}

// What the estimates say.

/// Charge of the last scan, as a force [N].
double ForceEstimator::signal(std::size_t taxel) const {
  const LeakageInverse& inverse = integration_->inverse();
  return inverse.charge()[taxel] * inverse.newton_per_charge()[taxel];
}

/// Offset of a signal [N], with what all have in common.
double ForceEstimator::offset(std::size_t taxel) const {
  const Belief& b = *belief();
  return b.error_of(taxel)[kOffset] + array_.time_constant[taxel] * b.shared[kDrift];
}

/// By how much one taxel, or one object, differs in warmth from others [K].
double ForceEstimator::warmth_difference() const {
  return priors_.warmth_least + priors_.warmth_spread * std::abs(belief()->shared[kWarmth]);
}

/// Variance of the warmth of a taxel about the common one, as a force [N2].
double ForceEstimator::warmth_variance(std::size_t taxel) const {
  const double warmth = std::abs(belief()->shared[kWarmth]);
  const double own = warmth_difference() * touch_.warm()[taxel];
  const double contact = priors_.warmth_contact * warmth * touch_.range()[taxel];
  return square(array_.newton_per_kelvin[taxel]) * (square(own) + square(contact));
}

/// Variance of a force at the end of the last block, but for what one object differs from others by [N2]: no evidence
/// of a motion or a release depends on that.
double ForceEstimator::whole_variance(std::size_t taxel) const {
  const double* factor = state().correlated_error.data() + taxel * kCauses;
  return own_[taxel] + dot(factor, factor, kCauses) - square(factor[kOfObject]);
}

/// By how much forces beside a contact differ from what they have in common, relative to the decline: as much as that
/// itself, which is far from its prior where forces do not decline geometrically: beside a pad.
double ForceEstimator::tail_spread(const Belief& belief) const {
  return std::max(priors_.tail, std::abs(belief.shared[kTail]));
}

/// Rate of the film's temperature [K/s].
double ForceEstimator::film_rate() const {
  const std::vector<double>& shared = belief()->shared;
  return array_.film_lag > 0.0 ? (shared[kChip] - shared[kFilm]) / array_.film_lag : shared[kRate];
}

/// Number of taxels that are not faulty.
std::size_t ForceEstimator::usable() const {
  return taxels() - static_cast<std::size_t>(std::count(ignored().data(), ignored().data() + taxels(), true));
}

/// Whether the last contact ended before the stored blocks, and by so much time [s] `longer` ago. Half a block is
/// allowed for, as times are sums.
bool ForceEstimator::has_rested(double longer) const {
  return rested_ >= LastBlocks::kLag * kBlock + longer && rested_ + 0.5 * kBlock >= blocks_.duration() + longer;
}

void ForceEstimator::block_mean(double* out) const {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    out[taxel] = state().sum[taxel] / integration_->block().scans;
  }
}

void ForceEstimator::residual_charge(double* out) const {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    out[taxel] = signal(taxel) - offset(taxel);
  }
}

void ForceEstimator::force_variance(double* out) const {
  std::transform(own_.begin(), own_.end(), noise_variance_.begin(), out, std::plus<>());
}

void ForceEstimator::variance(double* out) const {
  std::transform(untouched_variance_.begin(), untouched_variance_.end(), noise_variance_.begin(), out, std::plus<>());
}

void ForceEstimator::steady_variance(double* out) const {
  variance(out);
  const double warmth = belief()->shared[kWarmth];
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    out[taxel] = std::max(out[taxel] - stepped_[taxel], noise_variance_[taxel]) +
                 square(array_.newton_per_kelvin[taxel] * warmth *
                        (touched_[taxel] ? 0.0 : touch_.warm()[taxel] + touch_.range()[taxel]));
  }
}

// What the caller changes.

void ForceEstimator::ignore(const bool* faulty) {
  TaxelFlags back(taxels());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    back[taxel] = ignored()[taxel] && !faulty[taxel];
  }
  state().ignored.set(faulty);
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
    state().correction[taxel] -= change[taxel];
    state().force[taxel] += change[taxel];
    state().held[taxel] += change[taxel];
    absorbed_.shift(taxel, -change[taxel]);
    mean_[taxel] += change[taxel];
    leaked_[taxel] = state().raw[taxel] - signal(taxel);
  }
  forget_blocks();
  drop_hypothesis();
  if (forced) {
    zero_known_ = true;
    unexplained_.reset();
    forget_touch();
    forget_contacts();
    integration_->watch_none();
    std::fill(state().clipped.begin(), state().clipped.end(), 0.0);
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
  const std::vector<double> mean = priors_.mean();
  const SquareMatrix prior = priors_.covariance();
  hot_film_.forget();
  thermal_contact_.reset();
  touch_.matrix(response_);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double* response = response_.data() + taxel * kSharedStates;
    const double shown = b.error_of(taxel)[kForceError] + dot(response, b.shared.data(), kSharedStates);
    std::array<double, kSharedStates> left{};
    left[kFilm] = response[kFilm];
    b.reset_force_error(taxel, shown + touch_.loops()[taxel], left.data(), noise_variance_[taxel]);
  }
  for (std::size_t state = 0; state < kSharedStates; ++state) {
    if (!is_of_touch(state)) {
      continue;
    }
    b.restart(state, mean[state], prior[state * kSharedStates + state]);
    for (std::size_t taxel = 0; taxel < taxels() && (state == kWarmth || state == kWeakWarmth); ++taxel) {
      const double response = response_[taxel * kSharedStates + state];
      b.slope_of(taxel, kOwnWarmth)[state] = response;
      b.error_of(taxel)[kOwnWarmth] += response * mean[state];
    }
  }
  touch_.reset();
}

// Start and restart.

void ForceEstimator::start(const double* charge) {
  integration_->inverse().start(charge);
  last_duration_ = kBlock;
  ForceIntegration::State& s = state();
  Belief& b = *belief();
  if (const double sensors = integration_->block().sensors; !std::isnan(sensors)) {
    readings_.start(integration_->block());  // it says what these temperatures are, and nothing else
    std::vector<double> mean = priors_.mean();
    SquareMatrix covariance = priors_.covariance();
    mean[kEarlier] = b.shared[kEarlier];
    covariance[kEarlier * kSharedStates + kEarlier] = b.variance(kEarlier);
    filter_.restart_temperature(sensors, mean.data(), covariance.data());
  }
  std::vector<double>& before = values_;
  std::vector<double>& remaining = noise_;
  touch_.matrix(response_);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    leaked_[taxel] = s.raw[taxel] - signal(taxel);
    const double left = s.offset_known[taxel] ? signal(taxel) - offset(taxel) : 0.0;
    before[taxel] = s.ignored[taxel] ? 0.0 : s.force[taxel];
    remaining[taxel] = s.ignored[taxel] ? 0.0 : left;
    s.held[taxel] = s.force[taxel] = std::max(left, 0.0);
    s.correction[taxel] = s.raw[taxel] - s.force[taxel];
    s.clipped[taxel] = 0.0;
    b.reset_force_error(taxel, s.correction[taxel] - touch_.loops()[taxel], response_.data() + taxel * kSharedStates,
                        noise_variance_[taxel] + b.own_of(taxel)[own_at(kOffset, kOffset)]);
    leaked_share_[taxel] = -0.5 * last_duration_ / present_time_constant(taxel);
    driven_[taxel * kSharedStates + kDrift] = -0.5 * last_duration_ * leak();
  }
  lower_bound_.start(before.data(), remaining.data());
  std::fill(last_mean_.begin(), last_mean_.end(), kUnknown);
  hot_film_.interrupt();
  b.integrate(leaked_share_.data(), driven_.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    absorbed_.restart(taxel, b);
    values_[taxel] = signal(taxel);
    chosen_[taxel] = !s.offset_known[taxel];
  }
  forget_blocks();
  drop_hypothesis();
  certainty_.start();
  unexplained_.reset();
  release_.restart();
  thermal_contact_.reset();
  integration_->block().started = true;
  rest_.start(values_.data());
  integration_->watch_none();
  restart(chosen_);
  start_block();
}

void ForceEstimator::forget() {
  farthest_ = rested_ = 0.0;
  zero_known_ = false;
  for (std::vector<double>* each : {&left_force_, &touch_force_, &tail_, &warmth_, &warmed_, &stepped_}) {
    std::fill(each->begin(), each->end(), 0.0);
  }
  left_deviation_.assign(taxels(), array_.left_charge);
  unexplained_ = UnexplainedResiduals(taxels(), array_.threshold);
  hot_film_.forget();
  *belief() = *make_belief(taxels(), priors_);
  touch_.reset();
  forget_contacts();
  state().offset_known.fill(false);
  std::fill(state().force.begin(), state().force.end(), 0.0);
  integration_->block().started = integration_->block().valid = false;
}

/// Forget all that the filter believes: what it says is impossible.
void ForceEstimator::start_over() {
  restarts_ += usable();
  forget();
  const std::vector<double> charge = integration_->inverse().charge();
  start(charge.data());
}

/// Restart taxels: no force, and the signal is offset, or charge left by an earlier force: what it has beyond an offset
/// that was known. After each rejection the deviation of that charge is larger.
void ForceEstimator::restart(const TaxelFlags& where) {
  if (!where.any()) {
    return;
  }
  ForceIntegration::State& s = state();
  Belief& b = *belief();
  touch_.matrix(response_);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    leaked_share_[taxel] = driven_[taxel * kSharedStates + kDrift] = 0.0;
    if (!where[taxel]) {
      continue;
    }
    const double tau = array_.time_constant[taxel];
    const double noise = noise_variance_[taxel];
    double* error = b.error_of(taxel);
    double* own = b.own_of(taxel);
    std::fill_n(b.slope_of(taxel, 0), kOwnStates * kSharedStates, 0.0);
    std::fill_n(own, kOwnStates * kOwnStates, 0.0);
    b.reset_force_error(taxel, s.raw[taxel] - touch_.loops()[taxel], response_.data() + taxel * kSharedStates, noise);
    error[kSmallForce] = error[kPyroelectric] = error[kOwnWarmth] = 0.0;
    own[own_at(kPyroelectric, kPyroelectric)] = square(priors_.pyroelectric);
    if (s.offset_known[taxel]) {
      left_deviation_[taxel] = array_.left_charge + std::abs(signal(taxel) - offset(taxel));
      own[own_at(kOffset, kOffset)] = square(kRestartDeviation * array_.threshold);
    } else {
      // The offset has the noise of the signal that it is set to; so has the force. A film that warms generates charge,
      // which is no offset: that of the present rate, as far as it has lasted.
      const double present = present_time_constant(taxel);
      const double charge =
          present * array_.newton_per_kelvin[taxel] * -std::expm1(-std::max(age() - array_.film_lag, 0.0) / present);
      error[kOffset] = signal(taxel) - tau * b.shared[kDrift] - charge * b.shared[kRate];
      b.slope_of(taxel, kOffset)[kRate] = -charge;
      own[own_at(kForceError, kOffset)] = own[own_at(kOffset, kForceError)] = noise;
      own[own_at(kOffset, kOffset)] = noise + square(left_deviation_[taxel]);
    }
    leaked_share_[taxel] = -0.5 * last_duration_ / present_time_constant(taxel);
    driven_[taxel * kSharedStates + kDrift] = -0.5 * last_duration_ * leak();
  }
  b.integrate(leaked_share_.data(), driven_.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (where[taxel]) {
      s.rate[taxel] = offset(taxel) / present_time_constant(taxel);
      s.offset_known[taxel] = false;
      s.clipped[taxel] = 0.0;
      s.correction[taxel] = s.raw[taxel];
      s.held[taxel] = s.force[taxel] = 0.0;
      absorbed_.restart(taxel, b);
    }
  }
  forget_blocks();
}

void ForceEstimator::start_block() {
  integration_->start_block(uniform_.may_open() && uniform_.observable() && !touched_.any());
}

// The end of a block.

void ForceEstimator::close_block(const bool* in_contact, const Vector<const Taxels*>& contacts) {
  try {
    estimate(in_contact, contacts);
  } catch (const std::domain_error&) {
    start_over();
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
  Taxels lost;
  if (find_unreleased(block.listed, lost)) {
    listed_contacts.push_back(&lost);
  }
  find_touched(block);
  measure(block);
  hot_film_.follow(block.touched.any(), block.duration);
  observe_noise(block);
  blocks_.push();
  if (uniform_.open()) {
    follow_unheated(block);
  }
  bool begun = false;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    // Beside a contact forces were small ones, and no zeros.
    const bool was_small = beside_[taxel] && listed_.any();
    begun = begun || (block.touched[taxel] && !touched_[taxel] && !was_small);
  }
  refuted_ = 0.0;
  const bool again = begun || is_refuted(block);
  if (again) {
    process_again(block.touched);
  }
  follow_witnesses(block);
  if (take_witness(block) || again) {
    filter_.predicted(block.response.data(), values_.data());
    std::transform(block.mean.begin(), block.mean.end(), values_.begin(), mean_.begin(), std::minus<>());
  }
  listed_.set(block.listed.data());
  observe_steady_force();
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

/// Process the newest block; return whether the sensors refute its zeros. All of its taxels are touched, then.
bool ForceEstimator::is_refuted(Block& block) {
  step(blocks_.size() - 1);
  if (refuted_ == 0.0 || blocks_.size() == 0) {
    return false;
  }
  touch_all(block);
  return true;
}

/// Forget what could be processed again, as that would undo what has been decided.
void ForceEstimator::forget_blocks() {
  blocks_.clear();
  witnesses_.clear();
  lone_drift_.restart();
}

}  // namespace posfet
