// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Kalman filter of the force errors: states that all taxels share, and five of each taxel; linear in the taxels.
///
/// A known force of taxel i measures z_i = d_i + r_i + h_i.s + noise. The update eliminates the taxels one by one: each
/// adds g_i g_i'/v_i to the information on s, with g_i = h_i + a.G_i and v_i = a.V_i.a + R_i, a = (1, 0, 1, 0, 0); then
/// each taxel is updated given s. That costs O(taxels) instead of O(taxels^3), and is exact but for what the process
/// noise of s makes common to the taxels (docs/estimation.md).
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "posfet_core/estimation/belief.hpp"
#include "posfet_core/estimation/small_matrix.hpp"

namespace posfet {

/// Expectation of a reading of the temperature sensors.
struct TemperatureInnovation {
  double innovation;           ///< Reading less expectation [K].
  Vector<double> sensitivity;  ///< Of the reading to the shared states.
  Vector<double> column;       ///< Covariance of the reading with the shared states.
  double variance;             ///< Variance of the innovation [K2].
};

/// Process noise and transition over a block, of the shared states and of each taxel.
struct BlockTransition {
  const double* after;      ///< Shared states at its end, [states].
  const double* matrix;     ///< Jacobian F of their transition, [states, states].
  const double* noise;      ///< Covariance Q of their process noise, [states, states].
  const double* leaked;     ///< Share T/tau of an offset that the integration adds to the force [1], [taxels].
  const double* driven;     ///< What the shared states add to the force errors, [taxels, states].
  const double* own_noise;  ///< Covariance of the process noise of each taxel [N2], [taxels, own, own].
};

/// Predicts and updates a belief.
class ForceErrorFilter {
public:
  /// The belief is changed in place. Throws std::invalid_argument where there is none.
  explicit ForceErrorFilter(std::shared_ptr<Belief> belief);

  const std::shared_ptr<Belief>& belief() const { return belief_; }

  /// Replace the belief by another one of the same array. Throws std::invalid_argument otherwise.
  void set_belief(std::shared_ptr<Belief> belief);

  /// Propagate over a block.
  void predict(const BlockTransition& block);

  /// Raise the uncertainty of the shared states, independently of the taxels' errors: they may have changed together in
  /// a direction, [states], by a size of this variance.
  void admit(const double* direction, double variance);

  /// Raise the uncertainty of the shared states and of all that follows from them: they may have been wrong together in
  /// a direction, [states], by a size of this variance, and the taxels' errors with them.
  void widen(const double* direction, double variance);

  /// Find the residuals of measured errors of the forces [N], their sensitivities g to the shared states, and their
  /// expected deviations [N]; with responses h, [taxels, states], and variances R of the measurements [N2]. Each output
  /// has one value or row for each taxel.
  void innovation(const double* measured, const double* response, const double* noise, double* residual,
                  double* sensitivity, double* deviation) const;

  /// Find the variances that the shared states give to residuals of these sensitivities g [N2].
  void shared_variance(const double* sensitivity, double* variance) const;

  /// Return the variance that the shared states give to one residual of this sensitivity, [states] [N2].
  double shared_variance(const double* sensitivity) const;

  /// Find what is left of residuals after an update by those of the taxels marked, in units of its expected deviation
  /// [1]: what all taxels share is gone then, of which each residual had more than of its own. `unmodelled` are the
  /// variances of what the filter knows nothing of [N2].
  void post_fit(const bool* updated, const double* measured, const double* response, const double* noise,
                const double* unmodelled, double* left) const;

  /// Find the errors of the forces for these responses to the shared states [N].
  void predicted(const double* response, double* errors) const;

  /// Find the forces that are left of measured ones without these errors [N].
  void forces(const double* measured, const double* response, double* force) const;

  /// Find by how much measured errors of the forces [N] differ from those that are predicted, with the small forces.
  void residuals(const double* measured, const double* response, double* residual) const;

  /// Update by the residuals of some taxels, with their sensitivities g and variances R.
  void update(const bool* where, const double* residual, const double* sensitivity, const double* noise);

  /// Update taxels by residuals that say nothing about the shared states.
  void update_alone(const bool* where, const double* residual, const double* sensitivity, const double* noise);

  /// Compare a reading of the sensors [K] of this variance [K2] with its expectation; `leaked_time` is that of a
  /// block [s].
  TemperatureInnovation temperature_innovation(double reading, double variance, double leaked_time) const;

  /// Update by a reading of the temperature sensors.
  void measure_temperature(double reading, double variance, double leaked_time);

  /// Update by a measurement of the shared states alone: what it differs from its expectation by, its sensitivity to
  /// them, [states], and the variance of its noise.
  void measure_shared(double innovation, const double* sensitivity, double variance);

  /// Forget the temperatures, but for a reading of the sensors [K], after a time that is unknown: film, chip and
  /// sensors have that temperature; their other states are as at the start, [states] and [states, states].
  void restart_temperature(double reading, const double* shared, const double* covariance);

  /// Find the own variance of each force error [N2], [taxels], and a factor of what they share [N], [taxels, states]:
  /// the covariance of the forces is diag(own) + factor factor'.
  void covariance_root(const double* response, double* own, double* factor) const;

private:
  struct Gain;

  void add_to_covariance(const double* direction, double variance);
  void become();
  void regress(std::size_t taxel);
  void inform(const bool* where, const double* residual, const double* sensitivity, const double* noise);
  void shift(const double* change);
  void require_temperatures() const;
  Gain gain_of(std::size_t taxel, double noise) const;
  void update_own(std::size_t taxel, const Gain& gain, double residual, const double* sensitivity);

  std::shared_ptr<Belief> belief_;
  // Work space.
  SquareMatrix matrix_;
  SquareMatrix transposed_;
  SquareMatrix covariance_;
  SquareMatrix root_;
  SquareMatrix inverse_;
  SquareMatrix regression_;     ///< A of `become`.
  SquareMatrix unexplained_;    ///< D of `become`.
  std::vector<double> spread_;  ///< G S of a taxel, [own, states].
  std::vector<double> row_;
  std::vector<double> pull_;  ///< Sum of g residual/v, [states].
};

}  // namespace posfet
