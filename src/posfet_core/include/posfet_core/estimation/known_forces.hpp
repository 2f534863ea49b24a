// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// When a force is known: policies of the zero-force updates, each for one situation.
///
/// A taxel's force is known while nothing touches it, while it is beside a contact but not in it, and after a release.
/// It is never known during motion: a filter that may explain motion by nuisance states does.
#pragma once

#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "posfet_core/flags.hpp"
#include "posfet_core/force_integration.hpp"
#include "posfet_core/grid.hpp"

namespace posfet {

/// Deviations from which on a residual is no error that the filter expects [1].
constexpr double kGate = 5.0;

/// Taxels whose residual no state explains: they are left out until they are explained, or known to be errors.
class UnexplainedResiduals {
public:
  /// Blocks over which residuals are averaged [1]: what errors leave of them in the filter is white.
  static constexpr int kPersistentBlocks = 16;

  /// A taxel is steady while its mean stays within this many standard deviations of its noise [1].
  static constexpr double kSteadyDeviations = 8.0;

  /// A negative force that lasts for this long is an error of the baseline [s]: no object pulls.
  static constexpr double kNegativeTime = 0.2;

  /// A small positive force that is steady for this long, without a contact, is an error of the baseline [s].
  static constexpr double kUnexplainedTime = 2.0;

  /// Such a force is small below this share of the contact threshold [1].
  static constexpr double kSmall = 0.25;

  /// Contact threshold [N].
  UnexplainedResiduals(std::size_t taxels, double threshold);

  /// Taxels with a positive residual: a touch may begin there.
  const TaxelFlags& rising() const { return rising_; }

  /// Time for which each taxel has been below zero [s].
  const std::vector<double>& below() const { return below_; }

  /// Process a block: add to a mask the taxels whose residuals have been positive in too many blocks. A slow press
  /// raises each of them by less than the noise. `where` are the taxels whose residuals count; these are in units of
  /// their expected deviations [1].
  void add_persistent(const bool* where, const double* residual, bool* odd);

  /// Process a block of `duration` [s]: residuals [N] that are unexplained where `odd`, uncorrected mean forces [N] and
  /// the standard deviations of these [N]. The taxels whose residual is an error of the baseline are marked.
  void update(const bool* odd, const double* residual, const double* mean, const double* noise, double duration,
              bool* errors);

  /// Forget everything but the averages.
  void reset();

private:
  double small_;
  TaxelFlags rising_;
  std::vector<double> below_;
  std::vector<double> steady_;  ///< Time for which each taxel has been steady above zero [s].
  std::vector<double> level_;   ///< Mean since when it has been [N].
  std::vector<double> mean_;    ///< Average residual [1].
};

/// Finds contacts that are still listed, as their forces are above the threshold, but were released.
///
/// A contact was released when its forces are jointly within their uncertainty, small against its recent peak, and
/// still; without the last, the end of a slow release would become zero too early.
class ReleaseDetector {
public:
  /// Blocks over which a released contact is still.
  static constexpr std::size_t kStillBlocks = 5;

  /// Blocks for which a contact must look released.
  static constexpr int kReleasedBlocks = 3;

  /// A released contact has less than this share of the recent peak of its total force left [1]. Of the force of a
  /// single taxel an error may be much, after a long touch.
  static constexpr double kReleasedShare = 0.3;

  /// Deviations by which the squares of a released contact's forces may exceed their mean [1]: zero forces do so once
  /// in a thousand times. Each time a contact stays that nothing touches.
  static constexpr double kReleasedDeviations = 3.09;

  /// Share of its recent peak by which a released contact may still move [1]: the film creeps back.
  static constexpr double kResidualMotion = 0.01;

  /// Decay of the recent peak from block to block [1]: 20 s.
  static constexpr double kPeakDecay = 0.999;

  /// Share of its force by which the signal of a contact has risen in the last blocks at least if it has just come [1]:
  /// what a released one leaves rises slowly.
  static constexpr double kRisenShare = 0.9;

  explicit ReleaseDetector(std::size_t taxels);

  std::size_t taxels() const { return peak_.size(); }

  /// Process a block: the taxels of each contact, mean forces [N], the same with the charge of bending, which moves as
  /// the forces do: as the bending becomes known, it would hide that they move [N]; by how much the signals rose in the
  /// last `kStillBlocks`, whatever was corrected since [N]; touched taxels, the variances of the forces [N2], and the
  /// standard deviation of a mean [N]. The taxels of released contacts are marked; returns whether there are any.
  bool update(const Vector<const Taxels*>& contacts, const double* mean, const double* course, const double* rise,
              const bool* touched, const double* variance, double noise, bool* released);

  /// Whether nothing touches a taxel that was touched, and is in no contact: its force has hardly changed in the last
  /// blocks, against the standard deviation of a mean [N] and its recent peak, or the `mean` of the block that comes
  /// next [N] is below zero, as no object pulls.
  bool has_left(std::size_t taxel, double mean, double noise) const;

  /// Forget the last blocks: an unknown time has passed since.
  void restart() { seen_ = 0; }

private:
  void follow(const Taxels& contact, const double* mean, const double* rise);

  bool has_just_come(const Taxels& contact, double total, const double* rise) const;

  bool looks_released(const Taxels& contact, const double* mean, const double* course, const double* variance,
                      double noise) const;

  std::vector<double> peak_;                ///< Recent peak force of each taxel [N].
  std::vector<double> object_;              ///< Recent peak of the total force of the contact that it was in [N].
  std::vector<std::vector<double>> means_;  ///< Means of the last blocks with the charge of bending, in turn [N].
  std::size_t seen_ = 0;                    ///< Number of blocks.
  std::vector<std::size_t> touched_for_;    ///< Number of blocks for which a taxel has been touched.
  std::vector<int> blocks_;                 ///< Number of blocks for which the contact of a taxel has looked released.
};

/// Hypothesis that all taxels changed because the film's temperature did, faster than the filter expects.
///
/// A press on the whole array looks the same at first. What distinguishes it is its pattern, as warming acts on every
/// taxel by its pyroelectric response; its rate; and, after `kConfirmation`, what the sensors show.
class UniformChange {
public:
  /// Deviations from which on a common residual needs this hypothesis where one residual alone is not expected, and
  /// from which on a taxel does not fit the pattern [1].
  static constexpr double kNoticeable = 3.0;

  /// Share of the taxels that may not fit the pattern [1].
  static constexpr double kMisfits = 0.2;

  /// Time after which the chip's sensors must show the change, and twice their lag [s]: three readings.
  static constexpr double kConfirmation = 0.3;

  /// A new reading is awaited for this long [s].
  static constexpr double kInterval = 0.15;

  /// Share of it that they must show [1].
  static constexpr double kConfirmed = 0.3;

  /// Least change that the sensors resolve, in deviations of what they show [1]; a smaller one is no contact.
  static constexpr double kDistinct = 4.0;

  /// Time with known forces for which a refused hypothesis is not made again [s]: where the whole array was pressed, it
  /// soon is again.
  static constexpr double kPause = 1.0;

  /// Pyroelectric signal of each taxel [N/K], and the relative standard deviation of these [1].
  UniformChange(std::vector<double> newton_per_kelvin, double spread);

  std::size_t taxels() const { return per_kelvin_.size(); }

  /// Whether the pattern is informative.
  bool observable() const { return observable_; }

  /// Whether the hypothesis is open for a rise of the forces.
  bool open() const { return !std::isnan(open_); }

  /// Whether the hypothesis may be made now.
  bool may_open() const { return pause_ <= 0.0; }

  /// The temperature change that explains the residuals [N] of a block of `duration` [s], of the taxels with a known
  /// force [K]; 0: there is none. `deviation` are their expected deviations [N], `own` those of what the taxels do not
  /// share [N], which averages out; `noticed`: one of the residuals alone is not expected.
  double temperature(const double* residual, const bool* where, const double* deviation, const double* own,
                     double duration, bool noticed);

  /// Open the hypothesis that the forces rise with the film's temperature.
  void begin() { open_ = 0.0; }

  /// What the sensors say of the hypothesis.
  struct Evidence {
    double claimed;     ///< Change of the film's temperature according to the hypothesis [K].
    double shown;       ///< The change of the film according to the sensors [K].
    double deviation;   ///< Standard deviation of that change [K].
    double negligible;  ///< Difference of both that makes no difference to the forces [K].
    double wait;        ///< Time after which the sensors show most of a change of the film [s].
  };

  /// Process a block of `duration` [s]; return whether the open hypothesis is wrong, as the share of the `judged`
  /// taxels that do not fit the pattern, `odd`, or the sensors say. It stays open while what it claims matters, and the
  /// sensors cannot decide.
  bool is_refused(std::size_t odd, std::size_t judged, const Evidence& evidence, double duration);

  /// Close the hypothesis as wrong.
  void refuse();

  /// Close the hypothesis, wrong or not.
  void close() { open_ = std::numeric_limits<double>::quiet_NaN(); }

private:
  double median_of(const double* values, const bool* where);

  std::vector<double> per_kelvin_;
  double spread_;
  bool observable_;
  double pause_ = 0.0;                                      ///< Time for which the hypothesis must not be made [s].
  double open_ = std::numeric_limits<double>::quiet_NaN();  ///< Time for which it has been open [s]; NaN: it is not.
  std::vector<double> work_;
};

}  // namespace posfet
