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

#include <limits>
#include <vector>

#include "posfet_core/flags.hpp"
#include "posfet_core/grid.hpp"
#include "posfet_core/thermometers.hpp"

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

  /// Time constant of each taxel [s].
  const std::vector<double>& time_constant() const { return time_constant_; }

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

/// What the forces of a block may do before its end.
struct IntegrationLimits {
  double long_step;      ///< A step longer than this leaves the time of a jump within it unknown [s].
  double greatest_loss;  ///< Deviation of what leaked in one step, summed over the taxels, with which forces are not
                         ///< valid [N].
  double noticeable;     ///< Force of a taxel from which a scan is tested for a uniform change [N].
  double fastest;        ///< Greatest rate of the film's temperature [K/s].
  double negligible;     ///< Uniform change of the film's temperature with which forces are still valid [K].
};

/// How charge leaks at other temperatures than that of the calibration: faster by a factor exp(a (T - T0)).
struct LeakTemperature {
  double coefficient;  ///< a [1/K].
  double deviation;    ///< Its standard deviation [1/K].
  double reference;    ///< T0 [degC]; NaN: unknown.
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
    std::vector<double> clipped;     ///< Force that leaked unseen while a taxel was saturated in the block [N].
    std::vector<double> held;        ///< Touched force at the end of the last block [N].
    double rise_deviation = 0.0;     ///< Relative standard deviation of what a force has changed by since then [1].
    std::vector<double> correlated_error;  ///< Factor E of the covariance E E' of the forces [N], [taxels, causes];
                                           ///< the last cause is what leaked in lost scans.
    TaxelFlags offset_known;               ///< Taxels whose offset is known.
    TaxelFlags ignored;                    ///< Faulty taxels.

    /// Whether all offsets are known of the taxels that are not faulty.
    bool knows_offsets() const;

    /// Number of taxels that are not faulty.
    std::size_t usable() const;
  };

  /// The block so far, and the readings in it.
  struct Block {
    bool started = false;      ///< Whether the next scan has a predecessor.
    bool valid = false;        ///< Whether the forces of all taxels are valid.
    bool may_remove = false;   ///< Whether a uniform change may be removed while nothing touches.
    double scans = 0.0;        ///< Number of scans [1].
    double elapsed = 0.0;      ///< Their duration [s].
    double square = 0.0;       ///< Sum of the squares of the steps [s2].
    double compensated = 0.0;  ///< Uniform change that was removed [N].
    double age = 0.0;          ///< Time since the first scan [s].
    double warmer = std::numeric_limits<double>::quiet_NaN();  ///< Temperature above that of the calibration [K].
    double leak = 1.0;  ///< Rate of the leakage, relative to that of the calibration [1].
    double reading = std::numeric_limits<double>::quiet_NaN();  ///< New reading of the temperature sensors [K].
    double sensors = std::numeric_limits<double>::quiet_NaN();  ///< The last reading [K].
  };

  /// Time constants [s], force per charge density [N m2/C] and per temperature of the film [N/K] of each taxel; number
  /// of causes of errors that the forces have in common, at least one.
  ForceIntegration(std::vector<double> time_constant, std::vector<double> newton_per_charge,
                   std::vector<double> newton_per_kelvin, const LeakTemperature& leak, const IntegrationLimits& limits,
                   std::size_t causes);

  std::size_t taxels() const { return inverse_.taxels(); }
  std::size_t causes() const { return causes_; }
  LeakageInverse& inverse() { return inverse_; }
  State& state() { return state_; }
  const State& state() const { return state_; }
  Block& block() { return block_; }
  const Block& block() const { return block_; }
  const IntegrationLimits& limits() const { return limits_; }

  /// Charge of a taxel in the last scan, as the force that would generate it [N].
  double signal(std::size_t taxel) const { return inverse_.charge()[taxel] * inverse_.newton_per_charge()[taxel]; }

  /// Time constant of the leakage at the temperature of the block [s].
  double time_constant(std::size_t taxel) const { return inverse_.time_constant()[taxel] / block_.leak; }

  Thermometers& thermometers() { return thermometers_; }

  /// Process the charge densities [C/m2] of a scan and the readings of the temperature sensors [degC], `step` seconds
  /// after the scan before, > 0. Returns false where there is none: the estimator has to start with this scan.
  bool process(const double* charge, const float* temperatures, std::size_t sensors, double step);

  /// Keep a uniform change out of the forces of a scan until the block ends: while nothing touches, no more of it than
  /// the film can warm in that time; during a touch, what the untouched taxels show, as far as the rate of the film's
  /// temperature is uncertain.
  void compensate_common_mode(bool touched);

  /// Note what leaked unseen of the saturated taxels in a step [s].
  void clip(const bool* saturated, double step);

  /// Process the charge densities [C/m2] of a scan, `step` seconds after the one before, > 0. Returns the standard
  /// deviation of what leaked in the step, summed over the taxels [N]; 0 in steps that are not long.
  double advance(const double* charge, double step);

  /// Start a new block: clear its sums, and let charge leak as the sensors' temperature has it. `may_remove`: as in
  /// `Block`.
  void start_block(bool may_remove);

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
  void set_leak();
  void shift(double factor);

  LeakageInverse inverse_;
  std::vector<double> newton_per_kelvin_;
  double mean_newton_per_kelvin_;  ///< Force per temperature of the film, mean of the taxels [N/K].
  LeakTemperature leak_;
  IntegrationLimits limits_;
  std::size_t causes_;
  State state_;
  Block block_;
  Thermometers thermometers_;
  Taxels untouched_;
  std::vector<double> small_;
  double share_ = 0.0;
  std::vector<double> work_;
};

}  // namespace posfet
