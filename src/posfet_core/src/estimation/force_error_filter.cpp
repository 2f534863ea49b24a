// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/force_error_filter.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <stdexcept>
#include <utility>

#include "posfet_core/estimation/shared_states.hpp"
#include "posfet_core/product.hpp"

namespace posfet {

namespace {

/// Share of a variance that is rounding error [1].
constexpr double kRounding = 1e-12;

}  // namespace

/// How a taxel's errors follow from a residual of its force.
struct ForceErrorFilter::Gain {
  std::array<double, kOwnStates> own;  ///< Covariance of the errors with the residual [N2].
  double weight;                       ///< One over its variance, but for what the shared states contribute [1/N2].
};

ForceErrorFilter::ForceErrorFilter(std::shared_ptr<Belief> belief) : belief_(std::move(belief)) {
  if (!belief_) {
    throw std::invalid_argument("a filter needs a belief");
  }
  const std::size_t states = belief_->states();
  for (SquareMatrix* work : {&matrix_, &transposed_, &covariance_, &root_, &inverse_, &regression_, &unexplained_}) {
    work->assign(states * states, 0.0);
  }
  spread_.assign(kOwnStates * states, 0.0);
  row_.assign(states, 0.0);
  pull_.assign(states, 0.0);
}

void ForceErrorFilter::set_belief(std::shared_ptr<Belief> belief) {
  if (!belief || belief->taxels() != belief_->taxels() || belief->states() != belief_->states()) {
    throw std::invalid_argument("belief must be of the same array");
  }
  belief_ = std::move(belief);
}

void ForceErrorFilter::predict(const BlockTransition& block) {
  Belief& b = *belief_;
  b.integrate(block.leaked, block.driven);
  for (std::size_t index = 0; index < b.own.size(); ++index) {
    b.own[index] += block.own_noise[index];
  }
  const std::size_t states = b.states();
  matrix_.assign(block.matrix, block.matrix + states * states);
  transpose(matrix_, transposed_, states);
  multiply(block.matrix, b.covariance().data(), root_.data(), states, states, states);
  multiply(root_.data(), transposed_.data(), covariance_.data(), states, states, states);
  for (std::size_t index = 0; index < covariance_.size(); ++index) {
    covariance_[index] += block.noise[index];
  }
  mirror_lower(covariance_, states);
  transpose(root_, matrix_, states);
  become();
  b.shared.assign(block.after, block.after + b.states());
}

void ForceErrorFilter::admit(const double* direction, double variance) {
  add_to_covariance(direction, variance);
  matrix_ = belief_->covariance();
  become();
}

void ForceErrorFilter::widen(const double* direction, double variance) {
  add_to_covariance(direction, variance);
  belief_->set_covariance(covariance_);
}

/// Set `covariance_` to that of the shared states, which may have changed together in a direction.
void ForceErrorFilter::add_to_covariance(const double* direction, double variance) {
  const std::size_t states = belief_->states();
  covariance_ = belief_->covariance();
  for (std::size_t row = 0; row < states; ++row) {
    for (std::size_t column = 0; column < states; ++column) {
      covariance_[row * states + column] += direction[row] * direction[column] * variance;
    }
  }
}

/// Replace the covariance S of the shared states by P = F S F' + Q, which is in `covariance_`, with S F' in `matrix_`,
/// and regress the taxels' errors on the new states: on them the old ones have the regression A = S F' P^-1, which
/// leaves D = S - A P A' of their covariance.
void ForceErrorFilter::become() {
  Belief& b = *belief_;
  const std::size_t states = b.states();
  root_of_covariance(covariance_, states, root_, inverse_);
  transpose(inverse_, transposed_, states);
  SquareMatrix& white = unexplained_;  // A L with P = L L'
  multiply(matrix_.data(), transposed_.data(), white.data(), states, states, states);
  multiply(white.data(), inverse_.data(), regression_.data(), states, states, states);
  for (std::size_t row = 0; row < states; ++row) {
    for (std::size_t column = 0; column <= row; ++column) {
      matrix_[row * states + column] = b.covariance()[row * states + column] -
                                       dot(white.data() + row * states, white.data() + column * states, states);
    }
  }
  mirror_lower(matrix_, states);
  unexplained_.swap(matrix_);
  for (std::size_t taxel = 0; taxel < b.taxels(); ++taxel) {
    regress(taxel);
  }
  b.set_covariance(covariance_, root_);
}

/// Regress the errors of a taxel on the new shared states. What these do not explain of the old ones stays as the
/// taxel's own.
void ForceErrorFilter::regress(std::size_t taxel) {
  Belief& b = *belief_;
  const std::size_t states = b.states();
  std::array<std::size_t, kOwnStates> regressed{};
  std::size_t count = 0;
  for (std::size_t state = 0; state < kOwnStates; ++state) {
    const double* slope = b.slope_of(taxel, state);
    if (std::any_of(slope, slope + states, [](double each) { return each != 0.0; })) {
      regressed[count++] = state;
    }
  }
  double* own = b.own_of(taxel);
  for (std::size_t one = 0; one < count; ++one) {
    const std::size_t row = regressed[one];
    multiply(b.slope_of(taxel, row), unexplained_.data(), row_.data(), 1, states, states);
    for (std::size_t other = 0; other <= one; ++other) {
      const std::size_t column = regressed[other];
      own[own_at(row, column)] += dot(row_.data(), b.slope_of(taxel, column), states);
      own[column * kOwnStates + row] = own[own_at(row, column)];
    }
  }
  for (std::size_t one = 0; one < count; ++one) {
    double* slope = b.slope_of(taxel, regressed[one]);
    multiply(slope, regression_.data(), row_.data(), 1, states, states);
    std::copy(row_.begin(), row_.end(), slope);
  }
}

void ForceErrorFilter::innovation(const double* measured, const double* response, const double* noise, double* residual,
                                  double* sensitivity, double* deviation) const {
  const Belief& b = *belief_;
  const std::size_t states = b.states();
  for (std::size_t taxel = 0; taxel < b.taxels(); ++taxel) {
    const double* force_error = b.slope_of(taxel, kForceError);
    const double* small_force = b.slope_of(taxel, kSmallForce);
    for (std::size_t state = 0; state < states; ++state) {
      const std::size_t index = taxel * states + state;
      sensitivity[index] = response[index] + force_error[state] + small_force[state];
    }
  }
  shared_variance(sensitivity, deviation);
  residuals(measured, response, residual);
  for (std::size_t taxel = 0; taxel < b.taxels(); ++taxel) {
    deviation[taxel] = std::sqrt(b.own_variance(taxel) + noise[taxel] + deviation[taxel]);
  }
}

void ForceErrorFilter::post_fit(const bool* updated, const double* measured, const double* response,
                                const double* noise, const double* unmodelled, double* left) const {
  const Belief& b = *belief_;
  residuals(measured, response, left);
  for (std::size_t taxel = 0; taxel < b.taxels(); ++taxel) {
    const double alone = b.own_variance(taxel);
    const double own = updated[taxel] ? std::max(noise[taxel] - alone, kRounding * noise[taxel]) : noise[taxel] + alone;
    left[taxel] /= std::sqrt(own + unmodelled[taxel]);
  }
}

void ForceErrorFilter::shared_variance(const double* sensitivity, double* variance) const {
  for (std::size_t taxel = 0; taxel < belief_->taxels(); ++taxel) {
    variance[taxel] = shared_variance(sensitivity + taxel * belief_->states());
  }
}

double ForceErrorFilter::shared_variance(const double* sensitivity) const {
  const std::size_t states = belief_->states();
  Vector<double> row(states);
  multiply(sensitivity, belief_->covariance().data(), row.data(), 1, states, states);
  return dot(row.data(), sensitivity, states);
}

void ForceErrorFilter::predicted(const double* response, double* errors) const {
  const Belief& b = *belief_;
  for (std::size_t taxel = 0; taxel < b.taxels(); ++taxel) {
    errors[taxel] = b.error_of(taxel)[kForceError] + dot(response + taxel * b.states(), b.shared.data(), b.states());
  }
}

void ForceErrorFilter::forces(const double* measured, const double* response, double* force) const {
  predicted(response, force);
  std::transform(measured, measured + belief_->taxels(), force, force, std::minus<>());
}

void ForceErrorFilter::residuals(const double* measured, const double* response, double* residual) const {
  forces(measured, response, residual);
  for (std::size_t taxel = 0; taxel < belief_->taxels(); ++taxel) {
    residual[taxel] -= belief_->error_of(taxel)[kSmallForce];
  }
}

ForceErrorFilter::Gain ForceErrorFilter::gain_of(std::size_t taxel, double noise) const {
  const double* own = belief_->own_of(taxel);
  Gain gain{};
  for (std::size_t state = 0; state < kOwnStates; ++state) {
    gain.own[state] = own[own_at(state, kForceError)] + own[own_at(state, kSmallForce)];
  }
  gain.weight = 1.0 / (gain.own[kForceError] + gain.own[kSmallForce] + noise);
  return gain;
}

/// Add to the information J on the shared states, seen through the root L, and to their pull what the residuals of some
/// taxels say: L'JL and the sum of g residual/v.
void ForceErrorFilter::inform(const bool* where, const double* residual, const double* sensitivity,
                              const double* noise) {
  const Belief& b = *belief_;
  const std::size_t states = b.states();
  std::fill(matrix_.begin(), matrix_.end(), 0.0);
  std::fill(pull_.begin(), pull_.end(), 0.0);
  for (std::size_t taxel = 0; taxel < b.taxels(); ++taxel) {
    if (!where[taxel]) {
      continue;
    }
    const double weight = gain_of(taxel, noise[taxel]).weight;
    const double* sensed = sensitivity + taxel * states;
    multiply(sensed, b.root().data(), row_.data(), 1, states, states);
    for (std::size_t row = 0; row < states; ++row) {
      add_scaled(weight * row_[row], row_.data(), matrix_.data() + row * states, row + 1);
      pull_[row] += weight * residual[taxel] * sensed[row];
    }
  }
}

void ForceErrorFilter::update(const bool* where, const double* residual, const double* sensitivity,
                              const double* noise) {
  Belief& b = *belief_;
  const std::size_t states = b.states();
  // S+ = L (I + L'JL)^-1 L' with S = LL': stays positive.
  inform(where, residual, sensitivity, noise);
  for (std::size_t state = 0; state < states; ++state) {
    matrix_[state * states + state] += 1.0;
  }
  replace_by_root(matrix_, states);
  invert_lower(matrix_, inverse_, states);
  transpose(inverse_, transposed_, states);
  multiply(b.root().data(), transposed_.data(), root_.data(), states, states, states);
  b.set_root(root_);
  multiply(pull_.data(), b.covariance().data(), row_.data(), 1, states, states);
  shift(row_.data());
  for (std::size_t taxel = 0; taxel < b.taxels(); ++taxel) {
    if (where[taxel]) {
      const double* sensed = sensitivity + taxel * states;
      update_own(taxel, gain_of(taxel, noise[taxel]), residual[taxel] - dot(sensed, row_.data(), states), sensed);
    }
  }
}

/// Change the shared states, and with them the errors of the taxels.
void ForceErrorFilter::shift(const double* change) {
  Belief& b = *belief_;
  const std::size_t states = b.states();
  for (std::size_t state = 0; state < states; ++state) {
    b.shared[state] += change[state];
  }
  for (std::size_t index = 0; index < b.error.size(); ++index) {
    b.error[index] += dot(b.slope.data() + index * states, change, states);
  }
}

void ForceErrorFilter::update_alone(const bool* where, const double* residual, const double* sensitivity,
                                    const double* noise) {
  for (std::size_t taxel = 0; taxel < belief_->taxels(); ++taxel) {
    if (where[taxel]) {
      update_own(taxel, gain_of(taxel, noise[taxel]), residual[taxel], sensitivity + taxel * belief_->states());
    }
  }
}

/// Update the errors of a taxel given the shared states.
void ForceErrorFilter::update_own(std::size_t taxel, const Gain& gain, double residual, const double* sensitivity) {
  Belief& b = *belief_;
  double* own = b.own_of(taxel);
  for (std::size_t state = 0; state < kOwnStates; ++state) {
    const double factor = gain.own[state] * gain.weight;
    if (factor == 0.0) {
      continue;  // known exactly
    }
    b.error_of(taxel)[state] += factor * residual;
    add_scaled(-factor, sensitivity, b.slope_of(taxel, state), b.states());
    for (std::size_t other = 0; other < kOwnStates; ++other) {
      own[own_at(state, other)] -= factor * gain.own[other];
    }
  }
}

void ForceErrorFilter::require_temperatures() const {
  if (belief_->states() < kThermal) {
    throw std::invalid_argument("the belief has no states for the temperatures");
  }
}

TemperatureInnovation ForceErrorFilter::temperature_innovation(double reading, double variance,
                                                               double leaked_time) const {
  require_temperatures();
  const Belief& b = *belief_;
  const double scale = 1.0 + b.shared[kScale];
  const double sensors = b.shared[kSensor] + b.shared[kEarlier] * leaked_time + b.shared[kZero];
  TemperatureInnovation found{reading - scale * sensors, Vector<double>(b.states(), 0.0), Vector<double>(b.states()),
                              variance};
  found.sensitivity[kSensor] = found.sensitivity[kZero] = scale;
  found.sensitivity[kEarlier] = scale * leaked_time;
  found.sensitivity[kScale] = sensors;
  multiply(found.sensitivity.data(), b.covariance().data(), found.column.data(), 1, b.states(), b.states());
  found.variance += dot(found.sensitivity.data(), found.column.data(), b.states());
  return found;
}

void ForceErrorFilter::measure_temperature(double reading, double variance, double leaked_time) {
  const TemperatureInnovation found = temperature_innovation(reading, variance, leaked_time);
  measure_shared(found.innovation, found.sensitivity.data(), variance);
}

void ForceErrorFilter::measure_shared(double innovation, const double* sensitivity, double variance) {
  Belief& b = *belief_;
  const std::size_t states = b.states();
  Vector<double> gain(states);
  multiply(sensitivity, b.covariance().data(), gain.data(), 1, states, states);
  const double total = dot(sensitivity, gain.data(), states) + variance;
  for (double& each : gain) {
    each /= total;
  }
  for (std::size_t state = 0; state < states; ++state) {
    row_[state] = gain[state] * innovation;
  }
  shift(row_.data());
  // The form of Joseph, which stays positive.
  for (std::size_t row = 0; row < states; ++row) {
    for (std::size_t column = 0; column < states; ++column) {
      matrix_[row * states + column] = (row == column ? 1.0 : 0.0) - gain[row] * sensitivity[column];
    }
  }
  transpose(matrix_, transposed_, states);
  multiply(matrix_.data(), b.covariance().data(), root_.data(), states, states, states);
  multiply(root_.data(), transposed_.data(), covariance_.data(), states, states, states);
  for (std::size_t row = 0; row < states; ++row) {
    for (std::size_t column = 0; column <= row; ++column) {
      covariance_[row * states + column] += variance * gain[row] * gain[column];
    }
  }
  mirror_lower(covariance_, states);
  b.set_covariance(covariance_);
}

void ForceErrorFilter::restart_temperature(double reading, const double* shared, const double* covariance) {
  require_temperatures();
  Belief& b = *belief_;
  const std::size_t states = b.states();
  for (std::size_t taxel = 0; taxel < b.taxels(); ++taxel) {  // V + G S G'
    multiply(b.slope_of(taxel, 0), b.covariance().data(), spread_.data(), kOwnStates, states, states);
    for (std::size_t index = 0; index < kOwnStates * kOwnStates; ++index) {
      const double* spread = spread_.data() + index / kOwnStates * states;
      b.own_of(taxel)[index] += dot(spread, b.slope_of(taxel, index % kOwnStates), states);
    }
  }
  std::fill(b.slope.begin(), b.slope.end(), 0.0);
  covariance_ = b.covariance();
  for (std::size_t thermal = 0; thermal < kThermal; ++thermal) {
    for (std::size_t state = 0; state < states; ++state) {
      const double value = state < kThermal ? covariance[thermal * states + state] : 0.0;
      covariance_[thermal * states + state] = covariance_[state * states + thermal] = value;
    }
  }
  b.set_covariance(covariance_);
  std::copy_n(shared, static_cast<std::size_t>(kThermal), b.shared.begin());
  b.shared[kChip] = b.shared[kFilm] = b.shared[kSensor] = reading;
}

void ForceErrorFilter::covariance_root(const double* response, double* own, double* factor) const {
  const Belief& b = *belief_;
  const std::size_t states = b.states();
  const SquareMatrix& root = b.root();
  Vector<double> row(states);
  for (std::size_t taxel = 0; taxel < b.taxels(); ++taxel) {
    const double* force_error = b.slope_of(taxel, kForceError);
    for (std::size_t state = 0; state < states; ++state) {
      row[state] = response[taxel * states + state] + force_error[state];
    }
    multiply(row.data(), root.data(), factor + taxel * states, 1, states, states);
    own[taxel] = std::max(b.own_of(taxel)[own_at(kForceError, kForceError)], 0.0);
  }
}

}  // namespace posfet
