// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/error_states.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "posfet_core/product.hpp"

namespace posfet {

namespace {

/// Deviation of the temperatures at the start, which are zero by definition [K]; not 0, for a regular covariance.
constexpr double kNegligibleTemperature = 1e-6;

constexpr std::size_t at(std::size_t row, std::size_t column) { return row * kSharedStates + column; }

/// Let a temperature follow the chip with a time constant [s], exact for a constant rate.
void follow(SquareMatrix& matrix, std::size_t row, double time, double duration) {
  const double ratio = time > 0.0 ? duration / time : std::numeric_limits<double>::infinity();
  const double gone = -std::expm1(-ratio);
  const double mean = ratio > 0.0 ? gone / ratio : 1.0;
  matrix[at(row, row)] = std::exp(-ratio);
  matrix[at(row, kChip)] = gone;
  matrix[at(row, kRate)] = duration * (1.0 - mean);
}

}  // namespace

std::vector<double> ErrorPriors::mean() const {
  std::vector<double> state(kSharedStates, 0.0);
  state[kLag] = std::log(lag);
  state[kTail] = tail;
  state[kWarmth] = warmth_mean;
  std::copy(bend_mean.begin(), bend_mean.end(), state.begin() + kBend);
  std::copy(creep_mean.begin(), creep_mean.end(), state.begin() + kCreep);
  return state;
}

SquareMatrix ErrorPriors::covariance() const {
  std::vector<double> deviations(kSharedStates, 0.0);
  deviations[kChip] = deviations[kFilm] = deviations[kSensor] = kNegligibleTemperature;
  deviations[kRate] = rate;
  deviations[kLag] = lag_spread;
  deviations[kScale] = scale;
  deviations[kEarlier] = earlier;
  deviations[kZero] = reading;
  std::copy(bend.begin(), bend.end(), deviations.begin() + kBend);
  deviations[kLeak] = leak;
  deviations[kWarmth] = warmth;
  deviations[kWeakWarmth] = warmth_contact * std::max(std::abs(warmth_mean), warmth);
  deviations[kTail] = tail_spread;
  deviations[kDrift] = drift;
  std::copy(creep.begin(), creep.end(), deviations.begin() + kCreep);
  SquareMatrix covariance(kSharedStates * kSharedStates, 0.0);
  for (std::size_t state = 0; state < kSharedStates; ++state) {
    covariance[at(state, state)] = deviations[state] * deviations[state];
  }
  return covariance;
}

SharedDynamics::SharedDynamics(const ErrorPriors& priors, double film_lag)
    : priors_(priors), film_lag_(film_lag), noise_(priors_.covariance()) {
  for (double& variance : noise_) {
    variance /= kForget;
  }
  noise_[at(kRate, kRate)] = priors_.rate_walk * priors_.rate_walk;
  for (const std::size_t state : {kSensor, kEarlier, kZero, kDrift, kTail}) {
    noise_[at(state, state)] = 0.0;
  }
  set_film_walk(priors_.film_walk * priors_.film_walk);
  transition_ = {std::vector<double>(kSharedStates), SquareMatrix(noise_.size()), SquareMatrix(noise_.size())};
  maneuver_.resize(kSharedStates);
}

void SharedDynamics::set_film_walk(double intensity) {
  for (const std::size_t row : {kChip, kFilm}) {
    for (const std::size_t column : {kChip, kFilm}) {
      noise_[at(row, column)] = intensity;
    }
  }
}

SharedTransition& SharedDynamics::transition(const std::vector<double>& state, double duration, double warming) {
  SquareMatrix& matrix = transition_.matrix;
  std::fill(matrix.begin(), matrix.end(), 0.0);
  for (std::size_t each = 0; each < kSharedStates; ++each) {
    matrix[at(each, each)] = 1.0;
  }
  const double lag = state[kLag];
  const double time = sensor_lag(state);
  matrix[at(kChip, kRate)] = duration;
  follow(matrix, kFilm, film_lag_, duration);
  follow(matrix, kSensor, time, duration);
  for (std::size_t row = 0; row < kSharedStates; ++row) {
    const double* each = matrix.data() + row * kSharedStates;
    transition_.after[row] = dot(each, state.data(), kSharedStates) + (row == kRate ? 0.0 : each[kRate] * warming);
  }
  if (kLeastLag < lag && lag < kGreatestLag) {
    // Derivative of the sensors' temperature with respect to the logarithm of the time constant.
    const double ratio = duration / time;
    const double behind = state[kChip] - state[kSensor];
    const double left = std::exp(-ratio);
    const double gone = -std::expm1(-ratio);
    matrix[at(kSensor, kLag)] = state[kRate] * (duration * left - time * gone) - behind * left * ratio;
  }
  std::transform(noise_.begin(), noise_.end(), transition_.noise.begin(),
                 [duration](double each) { return each * duration; });
  if (const double rate = std::abs(state[kRate]); rate > 0.0) {
    const double change = priors_.rate_change * rate;
    transition_.noise[at(kRate, kRate)] += change * change * duration * rate / (rate + priors_.slow_rate);
  }
  if (priors_.dead_share > 0.0) {
    // Far behind by a constant rate, sensors of both kinds are the same; until then they differ by a part of what they
    // are not yet behind, with the same sign for as long as the lag.
    const double unlike = priors_.dead_share * (state[kChip] - state[kSensor] - time * (state[kRate] + warming)) / time;
    transition_.noise[at(kSensor, kSensor)] += unlike * unlike * duration * time;
  }
  return transition_;
}

const std::vector<double>& SharedDynamics::maneuver(const std::vector<double>& state, double duration) {
  const SquareMatrix& matrix = transition(state, duration).matrix;
  for (std::size_t row = 0; row < kSharedStates; ++row) {
    maneuver_[row] = matrix[at(row, kRate)];
  }
  return maneuver_;
}

double SharedDynamics::sensor_lag(const std::vector<double>& state) {
  return std::exp(std::min(std::max(state[kLag], kLeastLag), kGreatestLag));
}

}  // namespace posfet
