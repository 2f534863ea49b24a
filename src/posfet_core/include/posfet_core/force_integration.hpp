// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Static forces from leaking charges, scan by scan: the inverse of the leakage, integrated, less a correction.
///
/// With signals s = k*sigma and a time constant tau, a step h changes the force by (s1 - s0)/mean + h/tau*s0, where
/// mean is (1 - exp(-h/tau))/(h/tau): the inverse of the first-order high-pass that leakage makes of the force.
///
/// The correction, its rate, and the small forces of untouched taxels come from the estimator, at each block's end.
#pragma once

#include <array>
#include <vector>

#include "posfet_core/grid.hpp"

namespace posfet {

/// With fewer taxels a uniform change is no evidence of a temperature [1]: a fingertip presses them all.
constexpr std::size_t kFewestForUniform = 5;

/// Quantile of the forces that represents the least-loaded taxels [1].
constexpr double kLeastLoaded = 0.2;

/// Coefficients of one time step h for each taxel.
struct LeakageCoefficients {
  double step = 0.0;           ///< h [s].
  std::vector<double> ratio;   ///< h/tau [1].
  std::vector<double> now;     ///< Factor of the charge density at the end of the step [N m2/C].
  std::vector<double> before;  ///< Factor of the charge density at the start of the step [N m2/C].
};

/// Inverse of the first-order high-pass that charge leakage makes of the force, one time constant per taxel.
class LeakageInverse {
public:
  /// Number of different steps whose coefficients are kept.
  static constexpr std::size_t kCacheSize = 64;

  /// Time constants [s], > 0, and force per charge density [N m2/C] of each taxel.
  LeakageInverse(std::vector<double> time_constant, std::vector<double> newton_per_charge);

  std::size_t taxels() const { return time_constant_.size(); }

  /// Set the charge densities of a first scan [C/m2], which has no predecessor.
  void start(const double* charge);

  /// Process the charge densities [C/m2] a step [s] later; the force increments [N] are written into `change`. Returns
  /// the coefficients of the step.
  const LeakageCoefficients& advance(const double* charge, double step, double* change);

  /// Charge densities of the last scan [C/m2].
  const std::vector<double>& charge() const { return charge_; }

  /// Force per charge density of each taxel [N m2/C].
  const std::vector<double>& newton_per_charge() const { return newton_per_charge_; }

private:
  const LeakageCoefficients& coefficients(double step);
  LeakageCoefficients& unused();

  std::vector<double> time_constant_;
  std::vector<double> newton_per_charge_;
  std::vector<double> charge_;
  std::vector<LeakageCoefficients> cache_;  ///< Allocated once; those with a step of 0 are not in use.
  std::size_t cached_ = 0;
  std::size_t last_ = 0;
};

/// Forces of all taxels [N], and their sums over a block of scans.
class ForceIntegration {
public:
  /// What each taxel holds; owned here, and changed by the estimator at the end of a block, too.
  struct State {
    std::vector<double> raw;         ///< Uncorrected force [N].
    std::vector<double> change;      ///< Change of the force in the last step according to the signal [N].
    std::vector<double> correction;  ///< Correction that is subtracted [N].
    std::vector<double> rate;        ///< Rate of the correction [N/s].
    std::vector<double> force;       ///< Corrected force [N].
    std::vector<double> sum;         ///< Sum of the forces of the scans of the block [N].
    std::vector<double> raw_sum;     ///< Sum of the uncorrected forces [N].
    std::vector<double> jumped;      ///< Variance of what leaked of jumps within long steps of the block [N2].
    std::vector<double> lost;        ///< Standard deviation of what leaked in lost scans, common to all taxels [N].
  };

  /// Time constants [s], force per charge density [N m2/C] and per temperature of the film [N/K] of each taxel; a step
  /// longer than `long_step` [s] leaves the time of a jump within it unknown.
  ForceIntegration(std::vector<double> time_constant, std::vector<double> newton_per_charge,
                   std::vector<double> newton_per_kelvin, double long_step);

  std::size_t taxels() const { return inverse_.taxels(); }
  LeakageInverse& inverse() { return inverse_; }
  State& state() { return state_; }

  /// Process the charge densities [C/m2] of a scan, `step` seconds after the one before, > 0. Returns the standard
  /// deviation of what leaked in the step, summed over the taxels [N]; 0 in steps that are not long.
  double advance(const double* charge, double step);

  /// Start a new block: clear its sums.
  void start_block();

  /// Set the untouched taxels that show the film's temperature during a touch, their small forces [N], and the share
  /// of a uniform change that is the film's [1]. Throws std::invalid_argument where a taxel is outside of the array.
  void watch(const Taxels& untouched, const double* small, double share);

  /// Watch no taxel.
  void watch_none() { untouched_.clear(); }

  /// Subtract from the forces what the watched taxels show of the film's temperature.
  void follow_untouched();

  /// Subtract a uniform change of the taxels that are not ignored: what the least-loaded of them feel, at most `most`,
  /// once one of them feels `noticeable`, all [N]. Returns what was subtracted from a taxel of average response [N].
  double remove_uniform(const bool* ignored, double noticeable, double most);

private:
  void shift(double factor);

  LeakageInverse inverse_;
  std::vector<double> newton_per_kelvin_;
  double mean_newton_per_kelvin_;
  double long_step_;
  State state_;
  Taxels untouched_;
  std::vector<double> small_;
  double share_ = 0.0;
  std::vector<double> work_;
};

}  // namespace posfet
