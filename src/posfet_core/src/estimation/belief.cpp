// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/belief.hpp"

#include <algorithm>
#include <functional>

#include "posfet_core/product.hpp"

namespace posfet {

Belief::Belief(std::size_t taxels, std::size_t states)
    : shared(states, 0.0),
      error(taxels * kOwnStates, 0.0),
      slope(taxels * kOwnStates * states, 0.0),
      own(taxels * kOwnStates * kOwnStates, 0.0),
      covariance_(states * states, 0.0),
      root_(states * states, 0.0) {}

const SquareMatrix& Belief::root() const {
  if (!rooted_) {
    SquareMatrix inverse;
    root_of_covariance(covariance_, states(), root_, inverse);
    rooted_ = true;
  }
  return root_;
}

void Belief::set_covariance(const SquareMatrix& covariance) {
  covariance_ = covariance;
  rooted_ = false;
}

void Belief::set_covariance(const SquareMatrix& covariance, const SquareMatrix& root) {
  covariance_ = covariance;
  root_ = root;
  rooted_ = true;
}

void Belief::set_root(const SquareMatrix& root) {
  root_ = root;
  rooted_ = true;
  const std::size_t size = states();
  for (std::size_t row = 0; row < size; ++row) {
    for (std::size_t column = 0; column <= row; ++column) {
      const double value = dot(root.data() + row * size, root.data() + column * size, size);
      covariance_[row * size + column] = covariance_[column * size + row] = value;
    }
  }
}

void Belief::add_to_force_error(std::size_t taxel, std::size_t state, double share) {
  double* errors = error_of(taxel);
  errors[kForceError] += share * errors[state];
  add_scaled(share, slope_of(taxel, state), slope_of(taxel, kForceError), states());
  double* covariance = own_of(taxel);
  for (std::size_t column = 0; column < kOwnStates; ++column) {
    covariance[own_at(kForceError, column)] += share * covariance[own_at(state, column)];
  }
  for (std::size_t row = 0; row < kOwnStates; ++row) {
    covariance[own_at(row, kForceError)] += share * covariance[own_at(row, state)];
  }
}

void Belief::integrate(const double* leaked, const double* driven) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    add_to_force_error(taxel, kOffset, leaked[taxel]);
    const double* drive = driven + taxel * states();
    error_of(taxel)[kForceError] += dot(drive, shared.data(), states());
    add_scaled(1.0, drive, slope_of(taxel, kForceError), states());
  }
}

void Belief::respond(const double* expected) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    add_to_force_error(taxel, kPyroelectric, expected[taxel]);
  }
}

void Belief::cool(const double* shares) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double share = shares[taxel];
    double& warmth = error_of(taxel)[kOwnWarmth];
    double* covariance = own_of(taxel);
    if (share == 0.0 || (covariance[own_at(kOwnWarmth, kOwnWarmth)] == 0.0 && warmth == 0.0)) {
      continue;
    }
    add_to_force_error(taxel, kOwnWarmth, -share);
    warmth *= 1.0 - share;
    double* slopes = slope_of(taxel, kOwnWarmth);
    std::transform(slopes, slopes + states(), slopes, [share](double each) { return (1.0 - share) * each; });
    for (std::size_t other = 0; other < kOwnStates; ++other) {
      covariance[own_at(kOwnWarmth, other)] *= 1.0 - share;
      covariance[own_at(other, kOwnWarmth)] *= 1.0 - share;
    }
  }
}

void Belief::forget_small_forces(const bool* where) {
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (where[taxel] && own_of(taxel)[own_at(kSmallForce, kSmallForce)] > 0.0) {
      error_of(taxel)[kSmallForce] = 0.0;
      forget(taxel, kSmallForce);
    }
  }
}

void Belief::restart(std::size_t state, double mean, double variance) {
  shared[state] = mean;
  for (std::size_t other = 0; other < states(); ++other) {
    covariance_[state * states() + other] = covariance_[other * states() + state] = other == state ? variance : 0.0;
  }
  rooted_ = false;
  for (std::size_t row = 0; row < taxels() * kOwnStates; ++row) {
    slope[row * states() + state] = 0.0;
  }
}

void Belief::forget(std::size_t taxel, std::size_t state) {
  std::fill_n(slope_of(taxel, state), states(), 0.0);
  double* covariance = own_of(taxel);
  for (std::size_t other = 0; other < kOwnStates; ++other) {
    covariance[own_at(state, other)] = covariance[own_at(other, state)] = 0.0;
  }
}

void Belief::reset_force_error(std::size_t taxel, double shown, const double* response, double variance) {
  forget(taxel, kForceError);
  error_of(taxel)[kForceError] = shown - dot(response, shared.data(), states());
  std::transform(response, response + states(), slope_of(taxel, kForceError), std::negate<>());
  own_of(taxel)[own_at(kForceError, kForceError)] = variance;
}

}  // namespace posfet
