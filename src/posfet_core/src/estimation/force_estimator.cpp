// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/force_estimator.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "posfet_core/medians.hpp"
#include "posfet_core/numbers.hpp"
#include "posfet_core/product.hpp"

namespace posfet {

namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

/// h/tau above which the time of a force change within a step matters [1].
constexpr double kLongStep = 0.05;

/// A taxel restarts when its force exceeds this many times the greatest force of the device [1]; a saturated taxel may
/// exceed the greatest force.
constexpr double kRunaway = 4.0;

/// Factor on the prior deviation of the residual charge after that prior was rejected [1].
constexpr double kRejected = 3.0;

/// Standard uncertainty of an offset that was known when its taxel restarted [contact threshold].
constexpr double kRestartDeviation = 0.1;

/// Greatest deviation of an untouched taxel's offset from the median offset [contact threshold]; a larger one requires
/// a longer rest.
constexpr double kOffsetSpread = 2.0;

/// Time for which a taxel must be consistent with a constant force before its offset counts as known [s].
constexpr double kSettleTime = 0.1;

/// Time after which a force without which an object released counts as none after an interruption [s].
constexpr double kLostForceTime = 2.0;

/// Deviations from which on a reading of the temperature sensors is unexpected [1].
constexpr double kSurprising = 3.0;

/// Greatest change of the logarithm of the sensors' lag by one reading [1]: the lag is nearly linear in it, then.
constexpr double kLargestLagStep = 0.5;

/// Longest time between two readings of the temperature sensors [s]: one that shows no change is none.
constexpr double kLongestInterval = 0.1;

/// Time after which a reading of the temperature sensors that has not changed counts again [s]: one and a half
/// intervals of board status.
constexpr double kRepeated = 0.15;

/// Time for which the rounding error of such a reading is the same [s], assumed: it counts for no more in that time.
constexpr double kSameError = 1.0;

/// Blocks over which the error of a taxel beside a contact, or that is still warm, stays the same [1]: one second.
constexpr double kCorrelated = 50.0;

/// Deviation of the force of a taxel beside a contact, in addition to shares of its neighbours' [N].
constexpr double kLeastTail = 1e-4;

/// Least force that stands in for an unknown one beside a contact [contact threshold].
constexpr double kLeastFelt = 0.1;

/// Share of the contact threshold that a taxel must read before a scan is tested for a uniform change [1].
constexpr double kNoticeable = 0.3;

/// Deviation of the total force that is always accepted [contact threshold].
constexpr double kLeastDeviation = 1.0;

/// Change of its temperature that no film survives [K]: a taxel whose response to it would not matter has none.
constexpr double kHottest = 1e3;

/// Warmth of touched taxels above which their forces are not valid [K]: force and warmth are hardly separable then.
constexpr double kGreatestWarmth = 0.08;

/// Variance of a pyroelectric response that is known exactly [1]: not 0, to divide by.
constexpr double kNegligibleResponse = 1e-12;

/// Deviations of a block's mean by which a force must change to have moved [1].
constexpr double kPlay = 4.0;

/// Time constant of the baseline that a slow press is compared with [s]; less for as long after a touch, as what its
/// end tells of the errors is no slow press.
constexpr double kAbsorbedTime = 1.0;

/// Causes of errors that the forces share besides the shared states: gain, the hypothesis of a warmer film, lost scans.
constexpr std::size_t kOtherCauses = 3;
constexpr std::size_t kCauses = kSharedStates + kOtherCauses;

constexpr std::size_t own_at(std::size_t row, std::size_t column) { return row * kOwnStates + column; }

double square(double value) { return value * value; }

double sum(const std::vector<double>& values) { return std::accumulate(values.begin(), values.end(), 0.0); }

/// Product of two changes of a force: of its change, and of the greater one of both.
double changed_square(double now, double before) { return std::abs(now - before) * std::max(now, before); }

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
    response = greatest < kLeastDeviation * array.threshold ? 0.0 : response;
  }
  return array;
}

/// Change of the film's temperature that makes no difference to the forces [K].
double negligible_change(const EstimatedArray& array) {
  double whole = 0.0;
  for (const double response : array.newton_per_kelvin) {
    whole += std::abs(response);
  }
  return whole > 0.0 ? kLeastDeviation * array.threshold / whole : std::numeric_limits<double>::infinity();
}

std::shared_ptr<ForceIntegration> make_integration(const EstimatedArray& array) {
  const double fastest = *std::min_element(array.time_constant.begin(), array.time_constant.end());
  const IntegrationLimits limits{kLongStep * fastest, kLeastDeviation * array.threshold, kNoticeable * array.threshold,
                                 UniformChange::kFastest, negligible_change(array)};
  return std::make_shared<ForceIntegration>(array.time_constant, array.newton_per_charge, array.newton_per_kelvin,
                                            limits, kCauses);
}

std::shared_ptr<Belief> make_belief(std::size_t taxels, const ErrorPriors& priors) {
  auto belief = std::make_shared<Belief>(taxels, kSharedStates);
  belief->shared = priors.mean();
  belief->set_covariance(priors.covariance());
  return belief;
}

double variance_of(const Belief& belief, std::size_t state) {
  return belief.covariance()[state * kSharedStates + state];
}

}  // namespace

ForceEstimator::ForceEstimator(EstimatedArray array, const ErrorPriors& priors, double block_duration)
    : array_(checked(std::move(array))),
      priors_(priors),
      block_duration_(block_duration),
      mean_per_kelvin_(sum(array_.newton_per_kelvin) / static_cast<double>(taxels())),
      negligible_(negligible_change(array_)),
      integration_(make_integration(array_)),
      dynamics_(priors_, array_.film_lag),
      filter_(make_belief(taxels(), priors_)),
      touch_(array_.layout, array_.time_constant, array_.newton_per_kelvin, priors_),
      uniform_(array_.newton_per_kelvin, priors_.pyroelectric),
      unexplained_(taxels(), array_.threshold),
      release_(taxels()),
      jumps_(array_.time_constant),
      walk_(priors_.film_walk, array_.film_lag),
      rest_(taxels(), array_.noise, kOffsetSpread * array_.threshold, kSettleTime,
            *std::max_element(array_.time_constant.begin(), array_.time_constant.end())),
      negative_(taxels(), UnexplainedResiduals::kNegativeTime),
      lower_bound_(taxels(), array_.threshold, kLostForceTime),
      surroundings_(Grid(array_.layout)),
      blocks_(taxels()),
      last_duration_(block_duration),
      left_deviation_(taxels(), array_.left_charge),
      noise_variance_(taxels(), square(array_.noise)) {
  for (auto* values : {
           &leaked_,   &mean_,     &last_mean_,          &steady_,    &usual_,         &untouched_time_,
           &absorbed_, &tail_,     &touch_force_,        &warmth_,    &own_,           &measured_,
           &noise_,    &residual_, &untouched_variance_, &deviation_, &own_deviation_, &leaked_share_,
           &values_,
       }) {
    values->assign(taxels(), 0.0);
  }
  for (auto* values : {&response_, &sensitivity_, &driven_}) {
    values->assign(taxels() * kSharedStates, 0.0);
  }
  own_noise_.assign(taxels() * kOwnStates * kOwnStates, 0.0);
  for (auto* mask : {&informative_, &listed_, &touched_, &beside_, &small_, &judged_, &zeros_, &odd_, &chosen_}) {
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

/// Variance of the warmth of a taxel about the common one, as a force [N2].
double ForceEstimator::warmth_variance(const Block& block, std::size_t taxel) const {
  const double level = priors_.warmth_least + priors_.warmth_spread * std::abs(belief()->shared[kWarmth]);
  return square(level * block.response[taxel * kSharedStates + kWarmth]);
}

/// By how much forces beside a contact differ from what they have in common, relative to the decline: as much as that
/// itself, which is far from its prior where forces do not decline geometrically: beside a pad.
double ForceEstimator::tail_spread() const { return std::max(priors_.tail, std::abs(belief()->shared[kTail])); }

/// Rate of the film's temperature [K/s].
double ForceEstimator::film_rate() const {
  const std::vector<double>& shared = belief()->shared;
  return array_.film_lag > 0.0 ? (shared[kChip] - shared[kFilm]) / array_.film_lag : shared[kRate];
}

/// Whether the temperature of the chip certainly changes.
bool ForceEstimator::warms() const {
  return std::abs(belief()->shared[kRate]) > 3.0 * std::sqrt(variance_of(*belief(), kRate));
}

/// Number of taxels that are not faulty.
std::size_t ForceEstimator::usable() const {
  return taxels() - static_cast<std::size_t>(std::count(ignored().data(), ignored().data() + taxels(), true));
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

// What the caller changes.

void ForceEstimator::ignore(const bool* faulty) {
  apply_clipped();
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

/// Increase the variance of saturated taxels by the leakage that the clipped signal did not show.
void ForceEstimator::apply_clipped() {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    double& clipped = state().clipped[taxel];
    if (clipped > 0.0) {
      double& own = belief()->own_of(taxel)[own_at(kForceError, kForceError)];
      own = square(std::sqrt(std::max(own, 0.0)) + clipped);
      clipped = 0.0;
    }
  }
}

void ForceEstimator::tare(bool forced, double* change) {
  apply_clipped();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    change[taxel] = ignored()[taxel] ? 0.0 : -(forced ? force()[taxel] : mean_[taxel]);
    belief()->error_of(taxel)[kForceError] -= change[taxel];
    belief()->own_of(taxel)[own_at(kForceError, kForceError)] += noise_variance_[taxel];
    state().correction[taxel] -= change[taxel];
    state().force[taxel] += change[taxel];
    usual_[taxel] -= change[taxel];
    mean_[taxel] += change[taxel];
  }
  blocks_.clear();
  drop_hypothesis();
  if (forced) {
    lower_bound_.clear();
    unexplained_.reset();
    touch_.reset();
    touched_.fill(false);
    beside_.fill(false);
    integration_->watch_none();
  }
  start_block();
}

// Start and restart.

void ForceEstimator::start(const double* charge) {
  apply_clipped();
  integration_->inverse().start(charge);
  last_duration_ = block_duration_;
  ForceIntegration::State& s = state();
  Belief& b = *belief();
  if (const double sensors = integration_->block().sensors; !std::isnan(sensors)) {
    filter_.restart_temperature(sensors, priors_.mean().data(), priors_.covariance().data());
  }
  std::vector<double>& before = values_;
  std::vector<double>& remaining = noise_;
  touch_.matrix(response_);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    leaked_[taxel] = s.raw[taxel] - signal(taxel);
    const double left = s.offset_known[taxel] ? signal(taxel) - offset(taxel) : 0.0;
    before[taxel] = s.ignored[taxel] ? 0.0 : s.force[taxel];
    remaining[taxel] = s.ignored[taxel] ? 0.0 : left;
    s.force[taxel] = std::max(left, 0.0);
    s.correction[taxel] = s.raw[taxel] - s.force[taxel];
    b.error_of(taxel)[kForceError] =
        s.correction[taxel] - dot(response_.data() + taxel * kSharedStates, b.shared.data(), kSharedStates);
    b.forget(taxel, kForceError);
    double* own = b.own_of(taxel);
    own[own_at(kForceError, kForceError)] = noise_variance_[taxel] + own[own_at(kOffset, kOffset)];
  }
  lower_bound_.start(before.data(), remaining.data());
  integrate(-0.5 * last_duration_);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    usual_[taxel] = b.error_of(taxel)[kForceError];
    values_[taxel] = signal(taxel);
    chosen_[taxel] = !s.offset_known[taxel];
  }
  blocks_.clear();
  drop_hypothesis();
  recent_force_.fill(0.0);
  negative_.reset();
  unexplained_.reset();
  integration_->block().started = true;
  rest_.start(values_.data());
  integration_->watch_none();
  restart(chosen_);
  start_block();
}

/// Add to the force errors what offsets and common drift cause in a time [s], which may be negative.
void ForceEstimator::integrate(double time) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    leaked_share_[taxel] = time * (1.0 / array_.time_constant[taxel]);
    driven_[taxel * kSharedStates + kDrift] = time;
  }
  belief()->integrate(leaked_share_.data(), driven_.data());
}

/// Restart taxels: no force, and the signal is offset, or charge left by an earlier force. After each rejection the
/// deviation of that charge is larger.
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
    error[kForceError] = s.raw[taxel] - dot(response_.data() + taxel * kSharedStates, b.shared.data(), kSharedStates);
    error[kSmallForce] = error[kPyroelectric] = 0.0;
    own[own_at(kPyroelectric, kPyroelectric)] = square(priors_.pyroelectric);
    own[own_at(kForceError, kForceError)] = noise;
    if (s.offset_known[taxel]) {
      left_deviation_[taxel] = array_.left_charge;
      own[own_at(kOffset, kOffset)] = square(kRestartDeviation * array_.threshold);
    } else {
      // The offset has the noise of the signal that it is set to; so has the force. A film that warms generates charge,
      // which is no offset: that of the present rate, as far as it has lasted.
      const double charge = tau * array_.newton_per_kelvin[taxel] * -std::expm1(-integration_->block().age / tau);
      error[kOffset] = signal(taxel) - tau * b.shared[kDrift] - charge * b.shared[kRate];
      b.slope_of(taxel, kOffset)[kRate] = -charge;
      own[own_at(kForceError, kOffset)] = own[own_at(kOffset, kForceError)] = noise;
      own[own_at(kOffset, kOffset)] = noise + square(left_deviation_[taxel]);
    }
    leaked_share_[taxel] = -0.5 * last_duration_ * (1.0 / tau);
    driven_[taxel * kSharedStates + kDrift] = -0.5 * last_duration_;
  }
  b.integrate(leaked_share_.data(), driven_.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (where[taxel]) {
      s.rate[taxel] = offset(taxel) / array_.time_constant[taxel];
      s.offset_known[taxel] = false;
      s.correction[taxel] = s.raw[taxel];
      s.force[taxel] = 0.0;
      usual_[taxel] = b.error_of(taxel)[kForceError];
    }
  }
  agreed_ = 0.0;
  blocks_.clear();
}

void ForceEstimator::start_block() {
  integration_->start_block(uniform_.may_open() && uniform_.observable() && !touched_.any());
}

// The end of a block.

void ForceEstimator::close_block(const bool* in_contact, const std::vector<const Taxels*>& contacts) {
  apply_clipped();
  Block& block = blocks_.next();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    block.listed[taxel] = in_contact[taxel] && offset_known()[taxel];
  }
  std::vector<const Taxels*> listed_contacts = contacts;
  Taxels lost;
  if (find_unreleased(block.listed, lost)) {
    listed_contacts.push_back(&lost);
  }
  surroundings_.dilate(lower_bound_.mask(), chosen_);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    // Those touched since before an interruption have a force that is unknown: not none, whatever the signal says.
    const bool suspected = unexplained_.rising()[taxel] || chosen_[taxel];
    block.touched[taxel] = block.listed[taxel] || (suspected && offset_known()[taxel]);
  }
  measure(block);
  const bool any_listed = block.listed.any();
  observe_rest(any_listed);
  blocks_.push();
  if (unheated_) {
    predict(*unheated_, block);
    measure_temperature(*unheated_, block, false);
  }
  bool begun = false;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    begun = begun || (block.touched[taxel] && !touched_[taxel] && !beside_[taxel]);
  }
  if (begun) {
    process_again(block.touched);
  } else {
    step(blocks_.size() - 1);
  }
  suspect_absorbed(block);
  listed_.set(block.listed.data());
  observe_steady_force();
  release(block, listed_contacts);
  if (lower_bound_.mask().any()) {
    end_unknown_touch(block);
  }
  touched_.set(block.touched.data());
  surroundings_.dilate(touched_, beside_);
  finish(block);
}

/// Add to the listed taxels those of a contact with the whole array that became uncertain, and was not released; they
/// are `lost`. Returns whether there are any. No untouched taxel shows the film's temperature: the uncertainty grows
/// until the contact is no longer significant. That is no evidence of zero forces.
bool ForceEstimator::find_unreleased(TaxelFlags& listed, Taxels& lost) const {
  std::size_t untouched = 0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    untouched += !ignored()[taxel] && !touched_[taxel] ? 1 : 0;
  }
  if (untouched >= kFewestForUniform) {
    return false;
  }
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const bool held = state().sum[taxel] > integration_->block().scans * array_.threshold;
    if (held && touched_[taxel] && !listed[taxel] && !ignored()[taxel] && offset_known()[taxel]) {
      listed[taxel] = true;
      lost.push_back(static_cast<Taxel>(taxel));
    }
  }
  return !lost.empty();
}

/// Measure the block that is due.
void ForceEstimator::measure(Block& block) {
  const ForceIntegration::Block& scans = integration_->block();
  block_mean(mean_.data());
  block.duration = scans.elapsed;
  block.span = 0.5 * (last_duration_ + scans.elapsed);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    block.mean[taxel] = state().raw_sum[taxel] / scans.scans;
    block.noise[taxel] = noise_variance_[taxel] / scans.scans;
    // What leaks in a block is its mean charge.
    const double leaked = state().raw[taxel] - signal(taxel);
    block.charge[taxel] = (leaked - leaked_[taxel]) * (array_.time_constant[taxel] / scans.elapsed);
    leaked_[taxel] = leaked;
    // Noise is no motion: without this play its path would count, which is long after a minute.
    const double play = kPlay * std::sqrt(block.noise[taxel]);
    steady_[taxel] = std::min(std::max(steady_[taxel], mean_[taxel] - play), mean_[taxel] + play);
  }
  take_reading(block);
  measure_touch(block);
  measure_process_noise(block);
  block.before = *belief();
  last_duration_ = scans.elapsed;
}

/// Take the new reading of the temperature sensors, or the last one if it has been the same for long enough.
void ForceEstimator::take_reading(Block& block) {
  ForceIntegration::Block& scans = integration_->block();
  unread_ += scans.elapsed;
  const bool repeated = std::isnan(scans.reading) && unread_ >= kRepeated && integration_->thermometers().known();
  block.reading = repeated ? scans.sensors : scans.reading;
  block.reading_variance = square(priors_.reading) * (repeated ? kSameError / kRepeated : 1.0);
  block.interval = std::min(unread_, kLongestInterval);
  if (!std::isnan(block.reading)) {
    scans.reading = kNone;
    unread_ = 0.0;
  }
}

/// Advance the responses to the touch, and find what it lets the taxels beside it feel.
void ForceEstimator::measure_touch(Block& block) {
  std::vector<double>& force = values_;
  surroundings_.dilate(block.listed, chosen_);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    force[taxel] = chosen_[taxel] ? std::max(steady_[taxel], 0.0) : 0.0;
  }
  touch_.advance(force, block.duration, belief()->shared[kLeak]);
  touch_.matrix(block.response);
  if (!block.touched.any()) {
    std::fill(block.neighbour.begin(), block.neighbour.end(), 0.0);
    std::fill(block.tail.begin(), block.tail.end(), 0.0);
    return;
  }
  const double least = kLeastFelt * array_.threshold;
  std::vector<double>& felt = values_;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    felt[taxel] = ignored()[taxel] ? kNone : std::abs(steady_[taxel]);
  }
  surroundings_.complete(felt, least);
  surroundings_.greatest_neighbour(felt, block.neighbour);
  surroundings_.geometric_decline(felt, least, block.tail);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    block.tail[taxel] = block.touched[taxel] ? 0.0 : block.tail[taxel];
  }
}

/// Find the process noise of a block: what the filter does not expect of the taxels, and of their temperature.
void ForceEstimator::measure_process_noise(Block& block) {
  const double scans_square = integration_->block().square;
  const double walk = square(priors_.offset_walk) * block.span;
  const bool touch = block.touched.any() || touch_.responding() || touched_.any();
  const double spread = square(tail_spread());
  double whole = 0.0;
  double moved = 0.0;
  double total = 0.0;
  double before = 0.0;
  std::fill(block.own_noise.begin(), block.own_noise.end(), 0.0);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    double* own = block.own_noise.data() + taxel * kOwnStates * kOwnStates;
    const double held = block.touched[taxel] ? std::max(steady_[taxel], 0.0) : 0.0;
    const double tail = block.tail[taxel];
    const double warmth = square(touch_.warm()[taxel]);
    const double leaked = scans_square * square(1.0 / array_.time_constant[taxel]);
    own[own_at(kForceError, kOffset)] = own[own_at(kOffset, kForceError)] = own[own_at(kOffset, kOffset)] = walk;
    double& grown = own[own_at(kForceError, kForceError)];
    grown = walk + noise_variance_[taxel] * leaked + state().jumped[taxel] + jumps_.variance(taxel, block.span);
    if (touch) {
      grown += square(priors_.motion) * changed_square(held, touch_force_[taxel]);
      own[own_at(kSmallForce, kSmallForce)] =
          spread * changed_square(tail, tail_[taxel]) +
          square(priors_.warmth_beside * array_.newton_per_kelvin[taxel]) * std::abs(warmth - warmth_[taxel]);
      whole += std::max(tail, tail_[taxel]);
      moved += std::abs(tail - tail_[taxel]);
    }
    total += held;
    before += touch_force_[taxel];
    touch_force_[taxel] = held;
    tail_[taxel] = tail;
    warmth_[taxel] = warmth;
  }
  block.tail_moved = whole > 0.0 ? moved / whole : 0.0;
  block.rate_noise = square(priors_.touch_rate) * changed_square(total, before);
}

/// Observe the noise of the oldest blocks, unless a touch may have begun in them, or has just ended.
void ForceEstimator::observe_rest(bool listed) {
  rested_ = listed ? 0.0 : rested_ + block_time();
  if (!blocks_.full() || rested_ < LastBlocks::kLag * block_duration_ + kQuiet) {
    walk_.pause();
    return;
  }
  const std::size_t count = usable();
  if (count < kFewestForUniform || !uniform_.observable()) {
    return;
  }
  const Block& before = blocks_[0];
  const Block& after = blocks_[1];
  const Block& later = blocks_[2];
  std::vector<double>& change = values_;
  std::fill(change.begin(), change.end(), 0.0);
  const double kelvin = add_change(before, after, change);
  const double both = add_change(after, later, change);
  double noise = 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double response = array_.newton_per_kelvin[taxel];
    change[taxel] -= response * both;
    chosen_[taxel] = !ignored()[taxel];
    noise += chosen_[taxel] ? after.noise[taxel] / square(response) : 0.0;
  }
  jumps_.observe(chosen_.data(), change.data(), after.noise.data(), after.span);
  const double known = walk_.intensity();
  walk_.observe(kelvin, 0.5 * kPi * noise / square(static_cast<double>(count)), after.span);  // that of a median
  if (const double grown = walk_.intensity() - known; grown > 0.0) {
    // A walk that was not expected counted as a drift of the offsets, as far as it can look like one.
    std::vector<double> drifting(kSharedStates, 0.0);
    drifting[kDrift] = 1.0;
    filter_.admit(drifting.data(), square(mean_per_kelvin_) * grown / integration_->block().age);
  }
  dynamics_.set_film_walk(walk_.intensity());
}

/// Add to changes of the mean forces [N] those from one block to the next, without what the offsets cause. Returns what
/// all have in common, as a change of the film's temperature [K].
double ForceEstimator::add_change(const Block& from, const Block& to, std::vector<double>& change) const {
  std::vector<double> kelvins;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double drift = offset(taxel) / array_.time_constant[taxel];
    change[taxel] += to.mean[taxel] - from.mean[taxel] - to.span * drift;
    if (!ignored()[taxel]) {
      kelvins.push_back(change[taxel] / array_.newton_per_kelvin[taxel]);
    }
  }
  return upper_median(kelvins);
}

/// Update the shared states by a force that has been steady in all stored blocks.
void ForceEstimator::observe_steady_force() {
  ++unobserved_;
  if (!blocks_.full() || unobserved_ < kHop || !blocks_.newest().listed.any()) {
    return;
  }
  unobserved_ = 0;
  const Taxels held = held_taxels();
  if (held.empty()) {
    return;
  }
  const Belief& b = *belief();
  const SteadyWindow window = window_of(held);
  double coldest = std::numeric_limits<double>::infinity();
  double warmest = -coldest;
  for (std::size_t index = 0; index < blocks_.size(); ++index) {
    coldest = std::min(coldest, blocks_[index].before.shared[kFilm]);
    warmest = std::max(warmest, blocks_[index].before.shared[kFilm]);
  }
  double response = 0.0;
  double noise = 0.0;
  for (const Taxel each : held) {
    response += array_.newton_per_kelvin[static_cast<std::size_t>(each)];
    noise += blocks_.newest().noise[static_cast<std::size_t>(each)];
  }
  const double changed = std::sqrt(variance_of(b, kRate)) * (window.time.back() - window.time.front());
  const auto found = steady_force(window, std::abs(response) * (warmest - coldest + changed), noise);
  if (!found) {
    return;
  }
  std::vector<double> spread(kSharedStates);
  multiply(found->sensitivity.data(), b.covariance().data(), spread.data(), 1, kSharedStates, kSharedStates);
  const double expected = dot(spread.data(), found->sensitivity.data(), kSharedStates) + found->variance;
  if (square(found->innovation) < square(kSurprising) * expected) {
    filter_.measure_shared(found->innovation, found->sensitivity.data(), found->variance);
  }
}

/// Taxels that have been in contact in all stored blocks, with a force that is known.
Taxels ForceEstimator::held_taxels() const {
  Taxels held;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    bool steady = !ignored()[taxel] && !lower_bound_.mask()[taxel];
    for (std::size_t index = 0; steady && index < blocks_.size(); ++index) {
      steady = blocks_[index].listed[taxel];
    }
    if (steady) {
      held.push_back(static_cast<Taxel>(taxel));
    }
  }
  return held;
}

/// What some taxels did in the stored blocks.
SteadyWindow ForceEstimator::window_of(const Taxels& held) const {
  const Belief& b = *belief();
  SteadyWindow window;
  window.response.assign(kSharedStates, std::vector<double>(blocks_.size(), 0.0));
  double time = 0.0;
  for (std::size_t index = 0; index < blocks_.size(); ++index) {
    const Block& block = blocks_[index];
    time += block.span;
    window.time.push_back(time);
    auto& force = window.force.emplace_back();
    auto& charge = window.charge.emplace_back();
    for (const Taxel each : held) {
      const auto taxel = static_cast<std::size_t>(each);
      std::array<double, kSharedStates> response{};
      std::copy_n(block.response.data() + taxel * kSharedStates, response.size(), response.begin());
      response[kLeak] = -block.charge[taxel];  // as it is, whatever its time constant
      charge.push_back(block.charge[taxel]);
      force.push_back(block.mean[taxel] - b.error_of(taxel)[kForceError] -
                      dot(response.data(), b.shared.data(), response.size()));
      response[kFilm] = 0.0;  // the only one of these states that is not constant
      for (std::size_t shared = 0; shared < kSharedStates; ++shared) {
        window.response[shared][index] += response[shared];
      }
    }
  }
  return window;
}

/// Set what a slow press may have lost to the zeros before, where taxels are newly listed. It counts in the deviation
/// only: the filter would explain the rest of the press by it.
void ForceEstimator::suspect_absorbed(const Block& block) {
  TaxelFlags begun(taxels());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    begun[taxel] = block.listed[taxel] && !listed_[taxel];
  }
  if (!begun.any()) {
    return;
  }
  surroundings_.dilate(begun, chosen_);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (chosen_[taxel] && !listed_[taxel]) {
      absorbed_[taxel] = std::max(belief()->error_of(taxel)[kForceError] - usual_[taxel], 0.0);
    }
  }
}

/// Set the forces of released contacts to zero.
void ForceEstimator::release(const Block& block, const std::vector<const Taxels*>& contacts) {
  std::vector<double>& variance = values_;
  const std::vector<double>& shared = state().correlated_error;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double* factor = shared.data() + taxel * kCauses;
    variance[taxel] = own_[taxel] + (contacts.empty() ? 0.0 : dot(factor, factor, kCauses));
  }
  const double noise = std::sqrt(*std::max_element(block.noise.begin(), block.noise.end()));
  if (!release_.update(contacts, mean_.data(), touched_.data(), variance.data(), noise, chosen_.data())) {
    return;
  }
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (chosen_[taxel]) {
      belief()->own_of(taxel)[own_at(kForceError, kForceError)] += square(absorbed_[taxel]);
    }
    noise_[taxel] = block.noise[taxel] + kCorrelated * (warmth_variance(block, taxel) + square(kLeastTail));
  }
  filter_.innovation(block.mean.data(), block.response.data(), noise_.data(), residual_.data(), sensitivity_.data(),
                     deviation_.data());
  filter_.update(chosen_.data(), residual_.data(), sensitivity_.data(), noise_.data());
}

/// End the touches since before an interruption: where forces stay below zero, they are zero.
void ForceEstimator::end_unknown_touch(const Block& block) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double limit = kGate * std::sqrt(2.0) * std::sqrt(block.noise[taxel]);
    chosen_[taxel] = std::abs(mean_[taxel] - last_mean_[taxel]) <= limit;
  }
  TaxelFlags ended(taxels());
  negative_.update(lower_bound_.mask().data(), mean_.data(), array_.threshold, chosen_.data(), block.duration,
                   ended.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    values_[taxel] = ended[taxel] ? mean_[taxel] : std::max(mean_[taxel], 0.0);
  }
  lower_bound_.update(values_.data(), block.duration);
  last_mean_ = mean_;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (ended[taxel]) {
      belief()->error_of(taxel)[kForceError] += mean_[taxel];
      belief()->forget(taxel, kForceError);
      belief()->own_of(taxel)[own_at(kForceError, kForceError)] = block.noise[taxel];
    }
  }
}

// A step of the filter.

/// Process the stored blocks again without the taxels that a touch, it turned out, had begun on.
void ForceEstimator::process_again(const TaxelFlags& touched) {
  ++processed_again_;
  *belief() = blocks_[0].before;
  const std::size_t count = blocks_.size();  // the newest one may restart taxels, which forgets them
  for (std::size_t index = 0; index < count; ++index) {
    Block& block = blocks_[index];
    block.before = *belief();
    for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
      block.touched[taxel] = block.touched[taxel] || touched[taxel];
    }
    step(index);
  }
}

/// Propagate the belief over a stored block, and update it by the temperature and by the forces that are known.
void ForceEstimator::step(std::size_t index) {
  const Block& block = blocks_[index];
  predict(filter_, block);
  bool zeros = false;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    double& variance = belief()->own_of(taxel)[own_at(kOffset, kOffset)];
    variance = std::max(variance, jumps_.least_offset_variance(taxel));
    zeros = zeros || (!block.touched[taxel] && !ignored()[taxel] && unexplained_.below()[taxel] == 0.0);
  }
  measure_temperature(filter_, block, zeros);
  measure_zeros(index);
}

/// Update a belief by a new reading of the temperature sensors, if there is one.
///
/// An unexpected one shows that the rate changed, at least as if the sensors had no lag. While zero forces determine
/// the temperature of the film, or if no change of the rate explains it, it shows only that the sensors differ from
/// their model, and is weighted down.
void ForceEstimator::measure_temperature(ForceErrorFilter& filter, const Block& block, bool zeros) {
  if (std::isnan(block.reading)) {
    return;
  }
  double variance = block.reading_variance;
  const auto is_surprising = [](const TemperatureInnovation& found) {
    return square(found.innovation) > square(kSurprising) * found.variance;
  };
  TemperatureInnovation found = filter.temperature_innovation(block.reading, variance);
  if (is_surprising(found) && !zeros) {
    const double rate = std::min(std::abs(found.innovation) / block.interval, priors_.fastest);
    filter.admit(dynamics_.maneuver(filter.belief()->shared, block.interval).data(), square(rate));
    found = filter.temperature_innovation(block.reading, variance);
  }
  if (is_surprising(found)) {
    variance += square(found.innovation / kSurprising);
    found = filter.temperature_innovation(block.reading, variance);
  }
  // The sensors' lag is exponential in its state: a step beyond the range of linearisation is made in parts.
  variance += std::max(std::abs(found.innovation * found.column[kLag]) / kLargestLagStep - found.variance, 0.0);
  filter.measure_temperature(block.reading, variance);
}

/// Propagate a belief over a block; finds the taxels beside a contact.
void ForceEstimator::predict(ForceErrorFilter& filter, const Block& block) {
  Belief& b = *filter.belief();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    small_[taxel] = !block.touched[taxel] && block.neighbour[taxel] > 0.0;
    chosen_[taxel] = !small_[taxel];
  }
  b.forget_small_forces(chosen_.data());
  own_noise_ = block.own_noise;
  const double spread = tail_spread();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const std::size_t place = taxel * kOwnStates * kOwnStates + own_at(kSmallForce, kSmallForce);
    if (small_[taxel] && b.own[place] == 0.0) {  // beside the contact since now
      own_noise_[place] = square(spread * block.tail[taxel] + priors_.tail_least * block.neighbour[taxel]);
    }
  }
  SharedTransition& shared = dynamics_.transition(b.shared, block.span);
  shared.noise[kTail * kSharedStates + kTail] = square(spread) * block.tail_moved;
  shared.noise[kRate * kSharedStates + kRate] += block.rate_noise;
  const double warming = shared.after[kFilm] - b.shared[kFilm];
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    values_[taxel] = array_.newton_per_kelvin[taxel] * warming;
    leaked_share_[taxel] = block.span * (1.0 / array_.time_constant[taxel]);
    driven_[taxel * kSharedStates + kDrift] = block.span;
  }
  b.respond(values_.data());
  filter.predict({shared.after.data(), shared.matrix.data(), shared.noise.data(), leaked_share_.data(), driven_.data(),
                  own_noise_.data()});
}

/// Update by the forces that are known to be zero or small.
void ForceEstimator::measure_zeros(std::size_t index) {
  const Block& block = blocks_[index];
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const bool usable = !ignored()[taxel];
    judged_[taxel] = usable && !(block.listed[taxel] && offset_known()[taxel]);
    zeros_[taxel] = usable && !(block.touched[taxel] && offset_known()[taxel]);
  }
  if (!judged_.any()) {
    return;
  }
  expect_small_forces(block);
  find_residuals();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    odd_[taxel] = std::abs(residual_[taxel]) > kGate * deviation_[taxel];
  }
  explain_by_temperature(index);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    zeros_[taxel] = zeros_[taxel] && !odd_[taxel];
  }
  filter_.update(zeros_.data(), residual_.data(), sensitivity_.data(), noise_.data());
  measure_faulty(block);
  if (index + 1 < blocks_.size()) {
    return;
  }
  TaxelFlags& watched = chosen_;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    watched[taxel] = judged_[taxel] || is_zero_faulty(block, taxel);
    zeros_[taxel] = watched[taxel] && !block.touched[taxel];
    values_[taxel] = residual_[taxel] / deviation_[taxel];
  }
  unexplained_.add_persistent(zeros_.data(), values_.data(), odd_.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    odd_[taxel] = odd_[taxel] && watched[taxel];
  }
  judge(block);
}

/// Whether a taxel is faulty, and in no contact.
bool ForceEstimator::is_zero_faulty(const Block& block, std::size_t taxel) const {
  return ignored()[taxel] && offset_known()[taxel] && !block.listed[taxel];
}

/// Update the faulty taxels by their forces, which say nothing of the others: a noisy taxel still counts in a contact,
/// and so must be zero before it.
void ForceEstimator::measure_faulty(const Block& block) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    zeros_[taxel] = is_zero_faulty(block, taxel) && !block.touched[taxel] && !odd_[taxel];
  }
  if (!zeros_.any()) {
    return;
  }
  filter_.predicted(response_.data(), values_.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    values_[taxel] = measured_[taxel] - values_[taxel] - belief()->error_of(taxel)[kSmallForce];
  }
  filter_.update_alone(zeros_.data(), values_.data(), sensitivity_.data(), noise_.data());
}

/// Find what the forces of the taxels would be but for errors, with their responses to the shared states and the
/// variances of their noise.
void ForceEstimator::expect_small_forces(const Block& block) {
  const std::vector<double>& shared = belief()->shared;
  measured_ = block.mean;
  response_ = block.response;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    noise_[taxel] = block.noise[taxel] + kCorrelated * warmth_variance(block, taxel);
    if (!small_[taxel]) {
      continue;
    }
    // What the shared states predict of the small force stays subtracted, as it is from the force.
    double* response = response_.data() + taxel * kSharedStates;
    for (std::size_t state = 0; state < kSharedStates; ++state) {
      if (is_of_touch(state)) {
        measured_[taxel] -= response[state] * shared[state];
        response[state] = 0.0;
      }
    }
    response[kTail] = block.tail[taxel];
    noise_[taxel] += kCorrelated * square(kLeastTail) + square(priors_.tail_change * block.neighbour[taxel]);
  }
}

void ForceEstimator::find_residuals() {
  filter_.innovation(measured_.data(), response_.data(), noise_.data(), residual_.data(), sensitivity_.data(),
                     deviation_.data());
}

/// Admit a change of the film's temperature where it explains residuals of a stored block that are not expected.
void ForceEstimator::explain_by_temperature(std::size_t index) {
  const Block& block = blocks_[index];
  const bool listed = block.listed.any();
  bool any_odd = false;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    any_odd = any_odd || (odd_[taxel] && zeros_[taxel]);
  }
  if (!listed && !any_odd) {
    return;
  }
  filter_.own_deviation(deviation_.data(), sensitivity_.data(), noise_.data(), own_deviation_.data());
  const double kelvin = uniform_.temperature(residual_.data(), judged_.data(), deviation_.data(), own_deviation_.data(),
                                             block.duration, listed);
  if (kelvin == 0.0) {
    return;
  }
  if (kelvin * mean_per_kelvin_ > 0.0 && !listed) {
    open_hypothesis(index);
  }
  const std::vector<double>& direction = dynamics_.maneuver(belief()->shared, block.duration);
  filter_.admit(direction.data(), square(kelvin / direction[kFilm]));
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    noise_[taxel] += square(priors_.pyroelectric * kelvin * array_.newton_per_kelvin[taxel]);
  }
  find_residuals();
  filter_.own_deviation(deviation_.data(), sensitivity_.data(), noise_.data(), own_deviation_.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double left = residual_[taxel] - kelvin * array_.newton_per_kelvin[taxel];
    odd_[taxel] = std::abs(left) > kGate * own_deviation_[taxel];
  }
}

/// Open the hypothesis that a stored block shows a warmer film, and go on without it, too.
void ForceEstimator::open_hypothesis(std::size_t index) {
  if (unheated_) {
    return;
  }
  uniform_.begin();
  unheated_ = std::make_unique<ForceErrorFilter>(std::make_shared<Belief>(*belief()));
  expected_film_ = belief()->shared[kFilm];
  expected_rate_ = belief()->shared[kRate];
  for (std::size_t later = index + 1; later < blocks_.size(); ++later) {
    predict(*unheated_, blocks_[later]);
  }
}

/// Keep the belief as it is: what the other one would say no longer matters.
void ForceEstimator::drop_hypothesis() {
  uniform_.close();
  unheated_.reset();
  doubt_ = 0.0;
}

/// Act on the residuals of the newest block that no state explains.
void ForceEstimator::judge(const Block& block) {
  const UniformChange::Evidence evidence = evidence_of(block);
  std::size_t odd = 0;
  std::size_t judged = 0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    odd += odd_[taxel] && judged_[taxel] ? 1 : 0;
    judged += judged_[taxel] ? 1 : 0;
  }
  if (uniform_.is_refused(odd, judged, evidence, block.duration)) {
    uniform_.refuse();
    take_unheated(block);
  }
  if (!uniform_.open()) {
    unheated_.reset();
  }
  doubt_ = unheated_ ? evidence.claimed - evidence.shown : 0.0;
  restart_or_correct(block);
}

/// What the sensors say of the hypothesis at the end of a block.
UniformChange::Evidence ForceEstimator::evidence_of(const Block& block) {
  UniformChange::Evidence evidence{kNone, kNone, kNone, negligible_, UniformChange::kConfirmation};
  // The hypothesis itself makes the sensors' lag seem longer.
  const Belief& shown = unheated_ ? *unheated_->belief() : *belief();
  if (unheated_) {
    expected_film_ += expected_rate_ * block.duration;
    evidence.claimed = belief()->shared[kFilm] - expected_film_;
    evidence.shown = shown.shared[kFilm] - expected_film_;
    evidence.deviation = std::sqrt(std::max(variance_of(shown, kFilm), 0.0));
  }
  evidence.wait += 2.0 * SharedDynamics::sensor_lag(shown.shared);
  evidence.wait += std::isnan(block.reading) ? UniformChange::kInterval : 0.0;
  return evidence;
}

/// Take the belief without the hypothesis, which was wrong.
void ForceEstimator::take_unheated(const Block& block) {
  if (!unheated_) {
    return;
  }
  *belief() = *unheated_->belief();
  filter_.predicted(block.response.data(), residual_.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    residual_[taxel] = block.mean[taxel] - residual_[taxel];
    odd_[taxel] = judged_[taxel] && residual_[taxel] > 0.0;
  }
  blocks_.clear();
}

/// Restart the taxels with an unexplained residual whose offset is unknown, and widen the errors of the others where it
/// is one of the baseline.
void ForceEstimator::restart_or_correct(const Block& block) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    chosen_[taxel] = odd_[taxel] && !offset_known()[taxel];
    odd_[taxel] = odd_[taxel] && offset_known()[taxel];
    if (chosen_[taxel]) {
      const double widened = kRejected * left_deviation_[taxel];
      left_deviation_[taxel] = std::min(widened, kRunaway * array_.greatest_force);
      ++restarts_;
    }
    values_[taxel] = std::sqrt(block.noise[taxel]);
  }
  restart(chosen_);
  unexplained_.update(odd_.data(), residual_.data(), block.mean.data(), values_.data(), block.duration, chosen_.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (chosen_[taxel]) {
      belief()->own_of(taxel)[own_at(kForceError, kForceError)] += square(residual_[taxel]);
    }
  }
}

// What holds until the end of the next block.

/// Set the correction of the next scans, covariance and validity.
void ForceEstimator::finish(const Block& block) {
  const Belief& b = *belief();
  ForceIntegration::State& s = state();
  const double rate = film_rate();
  std::vector<double>& predicted = values_;
  filter_.predicted(block.response.data(), predicted.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double leaking = offset(taxel) * (1.0 / array_.time_constant[taxel]);
    const double response = array_.newton_per_kelvin[taxel] * (1.0 + b.error_of(taxel)[kPyroelectric]);
    s.rate[taxel] = leaking + response * rate;
    s.correction[taxel] = predicted[taxel] + 0.5 * block.duration * s.rate[taxel];
    s.force[taxel] = s.raw[taxel] - s.correction[taxel];
    mean_[taxel] = block.mean[taxel] - predicted[taxel];
    usual_[taxel] += block.duration * leaking;
    if (touched_[taxel]) {
      untouched_time_[taxel] = 0.0;
    } else {
      untouched_time_[taxel] += block.duration;
      const double time = std::min(std::max(untouched_time_[taxel], block.duration), kAbsorbedTime);
      usual_[taxel] += block.duration / time * (b.error_of(taxel)[kForceError] - usual_[taxel]);
    }
  }
  set_covariance(block);
  agreed_ += block.duration;
  recovering_ = std::max(0.0, recovering_ - block.duration);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    chosen_[taxel] = std::abs(s.force[taxel]) > kRunaway * array_.greatest_force;
    restarts_ += chosen_[taxel] && !ignored()[taxel] ? 1 : 0;
  }
  restart(chosen_);
  confirm_offsets(block.duration);
  integration_->block().valid = is_valid();
  prepare_compensation(block);
  start_block();
}

void ForceEstimator::set_covariance(const Block& block) {
  const Belief& b = *belief();
  ForceIntegration::State& s = state();
  std::vector<double>& shared_variance = values_;
  filter_.covariance_root(block.response.data(), own_.data(), response_.data());
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    double* sensitivity = sensitivity_.data() + taxel * kSharedStates;
    for (std::size_t state = 0; state < kSharedStates; ++state) {
      const double response = is_of_touch(state) ? 0.0 : block.response[taxel * kSharedStates + state];
      sensitivity[state] = response + b.slope_of(taxel, kForceError)[state];
    }
  }
  filter_.shared_variance(sensitivity_.data(), shared_variance.data());
  if (!listed_.any()) {
    std::fill(absorbed_.begin(), absorbed_.end(), 0.0);
  }
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double held = touched_[taxel] ? std::max(s.force[taxel], 0.0) : 0.0;
    const double* own = b.own_of(taxel);
    double& lost = s.lost[taxel];
    lost = touched_[taxel] ? lost : 0.0;
    double* factor = s.correlated_error.data() + taxel * kCauses;
    std::copy_n(response_.data() + taxel * kSharedStates, kSharedStates, factor);
    factor[kSharedStates] = array_.common_gain_deviation * held;
    factor[kSharedStates + 1] = array_.newton_per_kelvin[taxel] * doubt_;
    factor[kSharedStates + 2] = lost;
    // The covariance without the responses to the touch itself, and without what the taxel's own response to a
    // temperature contributes, which grows during a touch only.
    const double by_response = square(own[own_at(kForceError, kPyroelectric)]) /
                               std::max(own[own_at(kPyroelectric, kPyroelectric)], kNegligibleResponse);
    untouched_variance_[taxel] = own_[taxel] - by_response + shared_variance[taxel];
    own_[taxel] -= std::min(own_[taxel], square(lost));  // in the covariance as each taxel's own
    own_[taxel] += square(array_.gain_deviation[taxel] * held) +
                   square(array_.leak_deviation[taxel] * touch_.leaked(taxel)) + warmth_variance(block, taxel);
    own_[taxel] += square(absorbed_[taxel]);
  }
}

/// Whether the forces are valid at the end of a block.
bool ForceEstimator::is_valid() {
  bool sound = true;
  bool any_touched = false;
  double missing = 0.0;
  double touching = 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (ignored()[taxel]) {
      missing += unexplained_.rising()[taxel] && informative_[taxel] ? mean_[taxel] : 0.0;
      continue;
    }
    sound = sound && offset_known()[taxel] && unexplained_.below()[taxel] == 0.0 && !lower_bound_.mask()[taxel];
    any_touched = any_touched || touched_[taxel];
    touching += touched_[taxel] ? force()[taxel] : 0.0;
  }
  recent_force_[recent_] = std::abs(touching);
  recent_ = (recent_ + 1) % recent_force_.size();
  if (recovering_ > 0.0 || !sound || std::abs(doubt_) > negligible_ || missing > kLeastDeviation * array_.threshold) {
    return false;
  }
  return !any_touched || is_certain();
}

/// Whether the total force of what touches is certain enough.
bool ForceEstimator::is_certain() const {
  if (std::abs(belief()->shared[kWarmth]) > kGreatestWarmth) {
    return false;
  }
  double variance = 0.0;
  std::array<double, kCauses> shared{};
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (touched_[taxel] && !ignored()[taxel]) {
      variance += own_[taxel];
      for (std::size_t cause = 0; cause < kCauses; ++cause) {
        shared[cause] += state().correlated_error[taxel * kCauses + cause];
      }
    }
  }
  variance += dot(shared.data(), shared.data(), kCauses);
  // A release makes the force small before it is found.
  const double greatest = *std::max_element(recent_force_.begin(), recent_force_.end());
  return std::sqrt(variance) <= std::max(max_relative_uncertainty * greatest, kLeastDeviation * array_.threshold);
}

/// Mark offsets as known once the array has been still.
void ForceEstimator::confirm_offsets(double duration) {
  if (offset_known().all()) {
    return;
  }
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    values_[taxel] = signal(taxel);
    chosen_[taxel] = !offset_known()[taxel];
  }
  // What all taxels have in common may be the film's temperature: judged by `UniformChange`, and no motion.
  const bool at_rest = rest_.update(values_.data(), ignored().data(), duration, uniform_.observable() || warms());
  if (rest_.moved()) {
    restart(chosen_);
  } else if (at_rest && agreed_ >= kSettleTime) {
    for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
      const double certain = square(0.5 * array_.threshold * array_.time_constant[taxel]);
      const bool known = belief()->own_of(taxel)[own_at(kOffset, kOffset)] <= certain && !ignored()[taxel];
      state().offset_known[taxel] = state().offset_known[taxel] || known;
    }
  }
}

/// Choose the untouched taxels that show the film's temperature scan by scan during a touch. Their small forces stay as
/// they are until the next block. The share of a uniform change that is the film's is the gain of the Kalman filter of
/// a random walk, in its limits of much and of little noise.
void ForceEstimator::prepare_compensation(const Block& block) {
  Taxels untouched;
  double noise = 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (!touched_[taxel] && !ignored()[taxel] && offset_known()[taxel]) {
      values_[untouched.size()] = mean_[taxel];
      untouched.push_back(static_cast<Taxel>(taxel));
      noise += noise_variance_[taxel];
    }
  }
  // Fewer than half of the taxels are all at the edge of what touches, and change with it.
  const std::size_t enough = std::max(kFewestForUniform, taxels() / 2);
  if (!touched_.any() || !uniform_.observable() || untouched.size() < enough) {
    integration_->watch_none();
    return;
  }
  const auto count = static_cast<double>(untouched.size());
  const double deviation = std::sqrt(noise / count / count);
  const double walk = std::abs(mean_per_kelvin_) * std::sqrt(variance_of(*belief(), kRate)) * block.duration /
                      integration_->block().scans;
  integration_->watch(untouched, values_.data(), walk / (walk + deviation));
}

}  // namespace posfet
