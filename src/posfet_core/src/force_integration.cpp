// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/force_integration.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "posfet_core/medians.hpp"

namespace posfet {

namespace {

/// Width of a uniform distribution over its standard deviation [1].
const double kUniformDeviation = std::sqrt(12.0);

/// Below, the mean of a decay rounds to 1.
constexpr double kTiny = 1e-20;

/// Temperatures by which the leakage is distinguished [K]: finer ones change with the sensors' noise.
constexpr double kLeakStep = 1.0 / 32.0;

/// Greatest logarithm of what a temperature makes of the leakage [1]: a sensor that is wrong must not stop it.
constexpr double kGreatestLeak = 1.5;

/// Mean of exp(-x*s) over s in [0, 1].
double mean_decay(double x) { return std::abs(x) < kTiny ? 1.0 : -std::expm1(-x) / x; }

}  // namespace

bool ForceIntegration::State::knows_offsets() const {
  bool known = true;
  for (std::size_t taxel = 0; taxel < offset_known.size(); ++taxel) {
    known = known && (offset_known[taxel] || ignored[taxel]);
  }
  return known;
}

std::size_t ForceIntegration::State::usable() const {
  return static_cast<std::size_t>(std::count(ignored.data(), ignored.data() + ignored.size(), false));
}

LeakageInverse::LeakageInverse(std::vector<double> time_constant, std::vector<double> newton_per_charge)
    : time_constant_(std::move(time_constant)), newton_per_charge_(std::move(newton_per_charge)) {
  if (newton_per_charge_.size() != time_constant_.size() || time_constant_.empty()) {
    throw std::invalid_argument("newton_per_charge must have one value for each time constant, and at least one");
  }
  charge_.assign(taxels(), 0.0);
  cache_.resize(kCacheSize);
}

void LeakageInverse::start(const double* charge) { charge_.assign(charge, charge + taxels()); }

const LeakageCoefficients& LeakageInverse::advance(const double* charge, double step, double* change) {
  const LeakageCoefficients& factors = coefficients(step);
  for (std::size_t taxel = 0; taxel < charge_.size(); ++taxel) {
    change[taxel] = charge[taxel] * factors.now[taxel] + charge_[taxel] * factors.before[taxel];
    charge_[taxel] = charge[taxel];
  }
  return factors;
}

const LeakageCoefficients& LeakageInverse::coefficients(double step) {
  if (cached_ > 0 && cache_[last_].step == step) {
    return cache_[last_];
  }
  const auto end = cache_.begin() + static_cast<std::ptrdiff_t>(cached_);
  const auto found = std::find_if(cache_.begin(), end, [step](const auto& known) { return known.step == step; });
  if (found != end) {
    last_ = static_cast<std::size_t>(found - cache_.begin());
    return *found;
  }
  LeakageCoefficients& made = unused();
  made.step = step;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    made.ratio[taxel] = step / time_constant_[taxel];
    made.now[taxel] = newton_per_charge_[taxel] / mean_decay(made.ratio[taxel]);
    made.before[taxel] = newton_per_charge_[taxel] * made.ratio[taxel] - made.now[taxel];
  }
  return made;
}

LeakageCoefficients& LeakageInverse::unused() {
  last_ = cached_ < kCacheSize ? cached_ : 0;
  cached_ = last_ + 1;
  LeakageCoefficients& place = cache_[last_];
  for (auto* values : {&place.ratio, &place.now, &place.before}) {
    values->resize(taxels());
  }
  return place;
}

ForceIntegration::ForceIntegration(std::vector<double> time_constant, std::vector<double> newton_per_charge,
                                   std::vector<double> newton_per_kelvin, const LeakTemperature& leak,
                                   const IntegrationLimits& limits, std::size_t causes)
    : inverse_(std::move(time_constant), std::move(newton_per_charge)),
      newton_per_kelvin_(std::move(newton_per_kelvin)),
      leak_(leak),
      limits_(limits),
      causes_(causes) {
  if (causes == 0) {
    throw std::invalid_argument("causes must be at least 1");
  }
  if (newton_per_kelvin_.size() != taxels()) {
    throw std::invalid_argument("newton_per_kelvin must have one value for each time constant");
  }
  mean_newton_per_kelvin_ = std::accumulate(newton_per_kelvin_.begin(), newton_per_kelvin_.end(), 0.0) /
                            static_cast<double>(newton_per_kelvin_.size());
  State& s = state_;
  for (auto* values : {&s.raw, &s.change, &s.correction, &s.rate, &s.force, &s.sum, &s.raw_sum, &s.jumped, &s.lost,
                       &s.clipped, &s.held}) {
    values->assign(taxels(), 0.0);
  }
  s.correlated_error.assign(taxels() * causes, 0.0);
  s.offset_known = TaxelFlags(taxels());
  s.ignored = TaxelFlags(taxels());
  untouched_.reserve(taxels());
  small_.reserve(taxels());
  work_.reserve(taxels());
}

bool ForceIntegration::process(const double* charge, const float* temperatures, std::size_t sensors, double step) {
  constexpr double kUnknownTime = std::numeric_limits<double>::infinity();
  const double reading = thermometers_.read(temperatures, sensors, block_.started ? step : kUnknownTime);
  if (!std::isnan(reading)) {
    block_.reading = block_.sensors = reading;
  }
  if (!block_.started) {
    return false;
  }
  const double lost = advance(charge, step);
  block_.scans += 1.0;
  block_.elapsed += step;
  block_.age += step;
  block_.square += step * step;
  if (lost > 0.0) {
    for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
      state_.correlated_error[taxel * causes_ + causes_ - 1] = state_.lost[taxel];
    }
    block_.valid = block_.valid && lost < limits_.greatest_loss;
  }
  return true;
}

void ForceIntegration::compensate_common_mode(bool touched) {
  follow_untouched();
  if (touched || !block_.may_remove) {
    return;
  }
  const double per_kelvin = std::abs(mean_newton_per_kelvin_);
  const double most = limits_.fastest * block_.elapsed * per_kelvin - block_.compensated;
  const double removed = remove_uniform(state_.ignored.data(), limits_.noticeable, most);
  if (removed > 0.0) {
    block_.compensated += removed;
    block_.valid = block_.valid && block_.compensated <= limits_.negligible * per_kelvin;
  }
}

void ForceIntegration::clip(const bool* saturated, double step) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (saturated[taxel]) {
      const double signal = inverse_.charge()[taxel] * inverse_.newton_per_charge()[taxel];
      state_.clipped[taxel] += std::abs(signal) * (step * block_.leak / inverse_.time_constant()[taxel]);
    }
  }
}

double ForceIntegration::advance(const double* charge, double step) {
  State& s = state_;
  const LeakageCoefficients& factors = inverse_.advance(charge, step * block_.leak, s.change.data());
  for (std::size_t taxel = 0; taxel < s.raw.size(); ++taxel) {
    s.raw[taxel] += s.change[taxel];
    s.raw_sum[taxel] += s.raw[taxel];
    s.correction[taxel] += s.rate[taxel] * step;
    s.force[taxel] = s.raw[taxel] - s.correction[taxel];
    s.sum[taxel] += s.force[taxel];
  }
  if (step <= limits_.long_step) {
    return 0.0;
  }
  // The charge of a jump within the step leaked by a share of h/tau that is unknown, uniformly distributed, and the
  // same for all taxels that jumped at once.
  double total = 0.0;
  for (std::size_t taxel = 0; taxel < s.raw.size(); ++taxel) {
    const double lost = std::abs(s.change[taxel]) * factors.ratio[taxel] / kUniformDeviation;
    s.jumped[taxel] += lost * lost;
    s.lost[taxel] = std::hypot(s.lost[taxel], lost);
    total += s.ignored[taxel] ? 0.0 : lost;
  }
  return total;
}

void ForceIntegration::start_block(bool may_remove) {
  for (auto* values : {&state_.sum, &state_.raw_sum, &state_.jumped}) {
    std::fill(values->begin(), values->end(), 0.0);
  }
  block_.scans = block_.elapsed = block_.square = block_.compensated = 0.0;
  block_.may_remove = may_remove;
  set_leak();
}

/// Let charge leak as it does at the sensors' temperature.
void ForceIntegration::set_leak() {
  block_.warmer = kLeakStep * std::round((thermometers_.temperature() - leak_.reference) / kLeakStep);
  if (!std::isnan(block_.warmer)) {
    block_.leak = std::exp(std::min(std::max(leak_.coefficient * block_.warmer, -kGreatestLeak), kGreatestLeak));
  }
}

void ForceIntegration::watch(const Taxels& untouched, const double* small, double share) {
  for (const Taxel taxel : untouched) {
    if (taxel < 0 || static_cast<std::size_t>(taxel) >= taxels()) {
      throw std::invalid_argument("untouched must have indices of taxels");
    }
  }
  untouched_ = untouched;
  small_.assign(small, small + untouched.size());
  share_ = share;
}

void ForceIntegration::follow_untouched() {
  if (untouched_.empty()) {
    return;
  }
  work_.clear();
  for (std::size_t index = 0; index < untouched_.size(); ++index) {
    const auto taxel = static_cast<std::size_t>(untouched_[index]);
    const double kelvin = (state_.force[taxel] - small_[index]) / newton_per_kelvin_[taxel];
    if (std::isnan(kelvin)) {  // which has no place in an order
      shift(kelvin);
      return;
    }
    work_.push_back(kelvin);
  }
  shift(share_ * median(work_));
}

double ForceIntegration::remove_uniform(const bool* ignored, double noticeable, double most) {
  work_.clear();
  bool reached = false;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (!ignored[taxel]) {
      if (std::isnan(state_.force[taxel])) {
        return 0.0;
      }
      reached = reached || state_.force[taxel] >= noticeable;
      work_.push_back(state_.force[taxel]);
    }
  }
  if (!reached || work_.size() < kFewestForUniform) {
    return 0.0;
  }
  const auto index = static_cast<std::ptrdiff_t>(kLeastLoaded * static_cast<double>(work_.size()));
  std::nth_element(work_.begin(), work_.begin() + index, work_.end());
  const double least = std::min(work_[static_cast<std::size_t>(index)], most);
  if (!(least > 0.0)) {
    return 0.0;
  }
  shift(least / mean_newton_per_kelvin_);
  return least;
}

/// Subtract the signals of a change of the film's temperature by `factor` [K].
void ForceIntegration::shift(double factor) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double signal = newton_per_kelvin_[taxel] * factor;
    state_.correction[taxel] += signal;
    state_.force[taxel] -= signal;
  }
}

}  // namespace posfet
