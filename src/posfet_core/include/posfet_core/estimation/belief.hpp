// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What is known about the errors of the forces.
///
/// Given the states s that all taxels share, the errors of the taxels are independent: with t = (d, o, r, p, w), error
/// of the force, offset of the signal, small force beside a contact, relative error of the pyroelectric response and
/// own warmth of a taxel, t = m + G (s - s^) + e, cov(e) = V, cov(s) = S.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "posfet_core/estimation/small_matrix.hpp"
#include "posfet_core/flags.hpp"

namespace posfet {

/// States of each taxel: t = (d, o, r, p, w).
constexpr std::size_t kOwnStates = 5;

// Position of each of them.
constexpr std::size_t kForceError = 0;    ///< d [N].
constexpr std::size_t kOffset = 1;        ///< o [N].
constexpr std::size_t kSmallForce = 2;    ///< r [N]; known exactly, 0, but beside a contact.
constexpr std::size_t kPyroelectric = 3;  ///< p [1].
constexpr std::size_t kOwnWarmth = 4;     ///< w [N]: the part of d that vanishes as the film cools.

/// Place of an element of the covariance of a taxel's states.
constexpr std::size_t own_at(std::size_t row, std::size_t column) { return row * kOwnStates + column; }

/// Add a variance to the own warmth of a taxel, which is a part of the error of its force, in their covariance.
inline void add_own_warmth(double* covariance, double variance) {
  double& both = covariance[own_at(kOwnWarmth, kForceError)];
  both += variance;
  covariance[own_at(kForceError, kOwnWarmth)] = both;
  covariance[own_at(kForceError, kForceError)] += variance;
  covariance[own_at(kOwnWarmth, kOwnWarmth)] += variance;
}

/// Means and covariance of the force errors; all arrays row by row.
class Belief {
public:
  /// Without errors, and with shared states that are 0 and known exactly.
  Belief(std::size_t taxels, std::size_t states);

  std::size_t taxels() const { return error.size() / kOwnStates; }
  std::size_t states() const { return shared.size(); }

  /// Covariance S of the shared states, [states, states].
  const SquareMatrix& covariance() const { return covariance_; }

  /// Variance of a shared state.
  double variance(std::size_t state) const { return covariance_[state * states() + state]; }

  /// A root L with S = L L'. Throws std::domain_error where S is not positive.
  const SquareMatrix& root() const;

  /// Replace S.
  void set_covariance(const SquareMatrix& covariance);

  /// Replace S by L L'.
  void set_root(const SquareMatrix& root);

  /// Replace S, of which a root is known.
  void set_covariance(const SquareMatrix& covariance, const SquareMatrix& root);

  /// Add to the force errors what causes them within a time t, which may be negative: `leaked`, the shares t/tau of the
  /// offsets that the integration adds [1], [taxels], and `driven`, what the shared states add, [taxels, states].
  void integrate(const double* leaked, const double* driven);

  /// Add to the force errors what the taxels' own responses make of a change of the film's temperature, by which each
  /// error is expected to change [N], [taxels].
  void respond(const double* expected);

  /// Let the parts of the force errors that are the taxels' own warmth vanish by shares [1], [taxels].
  void cool(const double* shares);

  /// Set the small forces of taxels to zero, as they are not beside a contact.
  void forget_small_forces(const bool* where);

  /// Restart a shared state with a variance, independent of all others.
  void restart(std::size_t state, double mean, double variance);

  /// Make one state of a taxel exactly known and independent of all others.
  void forget(std::size_t taxel, std::size_t state);

  /// The error of a force is all that a taxel shows [N], less what the shared states cause by its response to them,
  /// [states], with a variance [N2], and independent of its other states: the force itself is known.
  void reset_force_error(std::size_t taxel, double shown, const double* response, double variance);

  /// Variance of the errors of a taxel's force, d + r, given the shared states [N2].
  double own_variance(std::size_t taxel) const {
    const double* v = own_of(taxel);
    return std::max(v[own_at(kForceError, kForceError)] + 2.0 * v[own_at(kForceError, kSmallForce)] +
                        v[own_at(kSmallForce, kSmallForce)],
                    0.0);
  }

  /// Regression of one state of a taxel on the shared states, [states].
  double* slope_of(std::size_t taxel, std::size_t state) {
    return slope.data() + (taxel * kOwnStates + state) * states();
  }
  const double* slope_of(std::size_t taxel, std::size_t state) const {
    return slope.data() + (taxel * kOwnStates + state) * states();
  }

  /// Errors of a taxel.
  double* error_of(std::size_t taxel) { return error.data() + taxel * kOwnStates; }
  const double* error_of(std::size_t taxel) const { return error.data() + taxel * kOwnStates; }

  /// Covariance V of a taxel, [own, own].
  double* own_of(std::size_t taxel) { return own.data() + taxel * kOwnStates * kOwnStates; }
  const double* own_of(std::size_t taxel) const { return own.data() + taxel * kOwnStates * kOwnStates; }

  std::vector<double> shared;  ///< Shared states s^, [states].
  std::vector<double> error;   ///< Errors m of the taxels, [taxels, own].
  std::vector<double> slope;   ///< Regression G of these errors on the shared states, [taxels, own, states].
  std::vector<double> own;     ///< Covariance V of these errors given the shared states, [taxels, own, own].

private:
  /// Add to the force error of a taxel its error of another state, `share` times.
  void add_to_force_error(std::size_t taxel, std::size_t state, double share);

  SquareMatrix covariance_;
  mutable SquareMatrix root_;
  mutable bool rooted_ = false;
};

}  // namespace posfet
