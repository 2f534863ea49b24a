// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Detection of faulty taxels and of their recovery, at run time.
///
/// - Stuck: the counts stay constant although noise must change them, or although a charge so far from zero would leak,
///   or at the end of the range while no neighbour responds. Or the taxel holds a force of which its neighbours feel
///   clearly less than the elastomer skin must let them feel (skin_response.hpp).
/// - Noisy: the second differences of the counts far exceed the described noise, that of most taxels, and that of every
///   neighbour. Neighbours respond to a touch, too: the elastomer skin spreads it. Or the signal switches between two
///   levels (telegraph_noise.hpp).
/// - Dead: the taxel reads almost nothing while all taxels around it indicate a force on it.
///
/// What neighbours show counts as far as it exceeds their deviation, and the errors that negative forces among them
/// show: an object that warms the film makes all forces under it read low.
///
/// A dead taxel in a corner has one square of neighbours to indicate it, and in a single row of taxels none: there it
/// is not detected. A hole in an object, smaller than a cell, would look like a dead taxel. A stuck taxel whose noise
/// stays within one code of a coarse ADC is detected as a dead one, when it is pressed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "posfet_core/count_history.hpp"
#include "posfet_core/flags.hpp"
#include "posfet_core/grid.hpp"
#include "posfet_core/skin_response.hpp"
#include "posfet_core/telegraph_noise.hpp"

namespace posfet {

/// Greatest number of scans that are kept for the noise estimate.
constexpr std::size_t kMostScans = 64;

/// Period of the tests for noise and response [s], or that number of scans: every third block of 20 ms.
constexpr double kTestPeriod = 0.055;

/// Standard deviations of noise from which a force is informative about that of its neighbour [1].
constexpr double kInformative = 5.0;

/// Noise variance over the described one from which it is measured, with coarse codes [1]: a signal between two codes
/// switches between them, which is three times the variance of quantisation that is described, in all taxels at once.
constexpr double kCoarseLoud = 1.5;

/// Time after which a taxel that is noisy, or holds a force alone, counts as faulty; also the time constant of the
/// noise estimate [s], assumed as all that follow.
constexpr double kConfirm = 0.2;

/// Time after which a taxel without response under load is dead, and one that alone is at the end of its range is stuck
/// [s].
constexpr double kConfirmDead = 0.1;

/// Time without fault, while nothing touches, after which a taxel is usable again [s]: it begins without a force.
constexpr double kRecovery = 1.0;

/// Noise of a noisy taxel over that of the others [1].
constexpr double kNoisyFactor = 3.0;

/// Noise below which it has recovered, over that of the others [1].
constexpr double kQuietFactor = 2.0;

/// A touch moves some neighbour by at least one part in this many [1].
constexpr double kNeighbours = 20.0;

/// A taxel at the end of its range is there alone when no neighbour shows one part in this many of it [1].
constexpr double kAlone = 50.0;

/// Standard deviations by which the neighbours of a held force must miss what they must feel of it, and from which a
/// force is no error [1].
constexpr double kHeldCertainty = 4.0;

/// A noisy taxel reads at most this many times as much as a neighbour of a touch on both [1].
constexpr double kCommonTouch = 10.0;

/// Share of the expected force below which a taxel is dead [1].
constexpr double kDeadShare = 0.05;

/// Least expected force from which a taxel is tested for response [contact threshold].
constexpr double kDeadLoad = 5.0;

/// Time constants of the leakage after which even the greatest force is no longer at the end of the range [1].
constexpr double kLeakedRange = 5.0;

/// Status of a taxel; the values are those of TAXEL_* in posfet_msgs/TactileImage.
enum class TaxelStatus : std::uint8_t { kOk = 0, kDead = 1, kStuck = 2, kSaturated = 3, kAbsent = 4, kNoisy = 5 };

/// What the description of a sensor says of its taxels.
struct TaxelFigures {
  double threshold;          ///< Force from which a taxel is in contact [N].
  double release_threshold;  ///< Force below which it is no longer [N].
  double noise;              ///< Standard deviation of a reading [N].
  double newton_per_count;   ///< Change of a force by one count [N].
  double force_max;          ///< Greatest force [N].
  double time_constant;      ///< Of the leakage [s].
  double longest_run;        ///< Greatest number of scans in which counts may stay constant [1]; inf: no limit.
  bool coarse;               ///< Whether the noise is mostly that of the quantisation.
  bool spread_by_skin;       ///< Whether a neighbour responds to every touch.
};

/// What a block tells of the taxels.
struct TestedBlock {
  double duration;           ///< [s].
  const double* force;       ///< Mean forces of the block [N].
  const double* variance;    ///< Variance of each force at rest [N2].
  const double* charge;      ///< Charge at each gate, as a force [N].
  const bool* saturated;     ///< Taxels at the end of their range.
  const bool* offset_known;  ///< Taxels whose force is known, not only its changes.
};

/// Tests the taxels of one array block by block; the counts of each scan are added to `history`.
class TaxelFaultDetector {
public:
  /// `known_dead` are taxels known not to respond: these stay dead.
  TaxelFaultDetector(const SkinResponse& skin, const TaxelFigures& figures, const bool* known_dead);

  std::size_t taxels() const { return status_.size(); }

  /// Counts of the last scans.
  const std::shared_ptr<CountHistory>& history() const { return history_; }

  /// Status of each taxel: OK, dead, stuck or noisy.
  std::vector<TaxelStatus>& status() { return status_; }

  /// Taxels whose signal is meaningless, and whether there are such.
  TaxelFlags& faulty() { return faulty_; }
  const TaxelFlags& faulty() const { return faulty_; }
  bool any_faulty() const { return any_faulty_; }

  /// Median difference of two consecutive changes of each taxel [N].
  const std::vector<double>& usual_change() const { return usual_change_; }

  /// Variance of a reading of each taxel [N2]: measured if loud, else as described.
  const std::vector<double>& noise_variance() const { return noise_variance_; }

  /// Find the noisy taxels with a noise of at most `deviation` [N] whose readings are still informative: their
  /// neighbours must show part of any signal beyond that noise, as they would of a touch.
  void find_informative(double deviation, bool* found);

  /// End a block: test all taxels, and update their status; `touched` are those in or near a contact. Returns whether
  /// the set of faulty taxels changed.
  bool close_block(const TestedBlock& block, const Mask& touched);

  /// End a block of a duration [s] without a test: measure the noise of all taxels, and leave their status as it is.
  void measure_noise(double duration, const bool* saturated, const Mask& touched);

private:
  void add_to_period(double duration, const Mask& touched);
  bool is_period_over() const;
  void end_period();
  void end_block();
  void test_levels(double duration);
  void test_runs(const TestedBlock& block);
  double longest_saturation(std::size_t taxel) const;
  void test_noise(const bool* saturated);
  const double* update_levels(double usual);
  double find_second_differences();
  void compare_with_neighbours(double usual, const double* now);
  void find_shown_errors(const TestedBlock& block);
  void test_response(const double* force, const bool* offset_known);
  void test_alone(const double* force, const bool* offset_known);
  bool update_status(double duration);
  bool is_sound(std::size_t taxel) const;
  TaxelStatus next_status(std::size_t taxel) const;

  SkinResponse skin_;
  TaxelFigures figures_;
  TelegraphDetector telegraph_;
  std::shared_ptr<CountHistory> history_;
  double noise_;          ///< Described variance of a reading [counts2].
  double measured_from_;  ///< Variance from which it is measured [1], over the described one.
  TaxelFlags known_dead_;
  std::vector<TaxelStatus> status_;
  TaxelFlags faulty_;
  bool any_faulty_;
  std::size_t last_ = 0;  ///< Row of the last scan of the previous block.
  double elapsed_ = 0.0;  ///< Since the last tests for noise and response [s].
  TaxelFlags touched_;    ///< Since then.
  bool any_touched_ = false;
  std::vector<double> usual_change_;
  std::vector<double> noise_variance_;
  std::vector<double> run_;            ///< Length of the current run of constant counts [scans].
  std::vector<double> run_time_;       ///< The same [s].
  std::vector<double> level_;          ///< Variance of the noise where nothing touches [counts2].
  std::vector<double> level_overall_;  ///< The same where something touches, too [counts2].
  std::vector<double> noisy_for_;      ///< Durations of suspected faults and of the recovery [s].
  std::vector<double> quiet_for_;
  std::vector<double> alone_for_;
  std::vector<double> silent_for_;
  std::vector<double> responding_for_;
  TaxelFlags contradicted_;  ///< Noisy taxels whose force their neighbours contradict.
  TaxelFlags noisy_;
  TaxelFlags calm_;
  TaxelFlags dead_;
  TaxelFlags changed_;  ///< Taxels whose counts changed in the block.
  TaxelFlags stuck_;
  TaxelFlags loud_;
  TaxelFlags flags_;            ///< Of the test that runs.
  std::vector<double> values_;  ///< Of the test that runs.
  std::vector<double> others_;
  std::vector<double>
      square_;  ///< Of the second differences of each taxel: sum of the squares, then variance of the noise [counts2].
  std::vector<double> variance_;  ///< Of each force, with the errors that negative forces show [N2].
  std::vector<double> sizes_;     ///< Sizes of the second differences of one taxel [counts].
};

}  // namespace posfet
