// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// An array with all that is computed of its scans and blocks, and touches of it, for the fuzzers.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <iostream>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "posfet_core/block_end.hpp"
#include "posfet_core/contacts_cdr.hpp"
#include "posfet_core/reconstructor.hpp"
#include "posfet_core/scan_path.hpp"

namespace posfet {

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kPitch = 1.5e-3;
constexpr double kChargePerNewton = 3e-5;
constexpr double kNoise = 3.4e-4;
constexpr double kThreshold = 0.02;
constexpr double kCountsPerNewton = 2000.0;
constexpr double kTimeConstant = 0.27;
constexpr double kScanRate = 1000.0;
constexpr std::uint64_t kLayout = 7;

inline void require(bool holds, const char* what) {
  if (!holds) {
    std::cerr << "contradiction: " << what << '\n';
    std::exit(1);
  }
}

/// The priors that are shipped (posfet_model/estimation/error_states.py).
inline ErrorPriors priors() {
  ErrorPriors given{};
  given.film_walk = 4e-4;
  given.rate = 0.05;
  given.rate_walk = 2e-3;
  given.rate_change = 3.0;
  given.slow_rate = 3.0;
  given.touch_rate = 0.01;
  given.warming_share = 0.25;
  given.chip_times = {0.1, 1.0, 10.0};
  given.chip_warming = {0.01, 0.02, 0.02};
  given.fastest = 3.0;
  given.lag = 0.4;
  given.lag_spread = 0.8;
  given.scale = 0.04;
  given.reading = 3.5e-3;
  given.bend_mean = {0.0, 0.0, 0.0, 0.0};
  given.bend = {3e-3, 1.5e-3, 1.5e-3, 1.5e-3};
  given.leak = 0.1;
  given.tail = 0.1;
  given.tail_spread = 0.2;
  given.tail_least = 5e-3;
  given.tail_change = 3e-3;
  given.warmth_mean = 0.0;
  given.warmth = 0.015;
  given.warmth_least = 3e-3;
  given.warmth_spread = 0.25;
  given.warmth_force = 0.05;
  given.warmth_steepness = 1.0;
  given.dead_share = 0.5;
  given.warmth_force_spread = 10.0;
  given.warmth_certain = 1.0;
  given.warmth_contact = 0.58;
  given.warmth_time = 0.5;
  given.creep_times = {0.3, 2.0, 15.0};
  given.creep_mean = {0.0, 0.0, 0.0};
  given.creep = {8e-3, 0.012, 0.015};
  given.loop_half_widths = {0.025, 0.1, 0.4};
  given.loop_weights = {-0.01, -0.02, -0.01};
  given.loop_slope = -0.025;
  given.pyroelectric = 0.1;
  given.earlier = 3.5e-3;
  given.drift = 2e-4;
  given.offset_walk = 1e-5;
  given.motion = 0.01;
  return given;
}

inline std::shared_ptr<ForceEstimator> make_estimator(const Layout& layout, std::size_t taxels) {
  GivenArray array{layout,
                   std::vector<double>(taxels, kTimeConstant),
                   std::vector<double>(taxels, 1.0 / kChargePerNewton),
                   std::vector<double>(taxels, -1.0),
                   std::vector<double>(taxels, 0.03),
                   0.01,
                   std::vector<double>(taxels, 0.1),
                   {0.046, 0.005, 25.0},
                   kNoise,
                   kThreshold,
                   4.0,
                   1e-3,
                   0.05,
                   priors()};
  return std::make_shared<ForceEstimator>(std::move(array));
}

/// An array with all parts of its path, and one scan.
struct Board {
  Layout layout;
  SkinResponse skin;
  std::shared_ptr<ForceEstimator> estimator;
  std::shared_ptr<ForceIntegration> integration;
  std::shared_ptr<TaxelFaultDetector> faults;
  std::shared_ptr<CountHistory> history;
  std::shared_ptr<MainsHum> hum;
  std::shared_ptr<BurstDetector> bursts;
  std::shared_ptr<ContactFinder> finder;
  std::shared_ptr<ScanPath> path;
  std::shared_ptr<BlockEnd> block_end;
  std::unique_ptr<Reconstructor> reconstructor;
  ContactsWriter writer;
  std::vector<std::uint16_t> counts;
  std::vector<double> force;   ///< Of the fingers, in a film with leakage [N],
  std::vector<double> charge;  ///< and the charge that it left there, as a force [N].
  std::vector<float> temperatures;
  Scan scan;

  Board(Taxel rows, Taxel cols, double share, bool bent)
      : layout{rows, cols, kPitch, kPitch, 1e-6},
        skin(layout, 0.13, 0.13),
        writer({"finger", 7, "posfet", kThreshold, 0.01, Surface{bent ? 8e-3 : kInf, rows > cols}}),
        counts(static_cast<std::size_t>(rows * cols), 32768),
        force(counts.size(), 0.0),
        charge(counts.size(), 0.0),
        temperatures{25.0F, 25.0F} {
    const std::size_t taxels = counts.size();
    estimator = make_estimator(layout, taxels);
    integration = estimator->integration();
    const TaxelFigures figures{kThreshold, 0.01,  kNoise, 1.0 / kCountsPerNewton, 4.0, kTimeConstant,
                               200.0,      false, true};
    faults = std::make_shared<TaxelFaultDetector>(skin, figures, nullptr);
    history = faults->history();
    hum = std::make_shared<MainsHum>(taxels, kScanRate, kNoise * kChargePerNewton);
    bursts = std::make_shared<BurstDetector>(skin, 0.01 * kChargePerNewton, 1e-15, kChargePerNewton);
    finder = std::make_shared<ContactFinder>(layout, 0.6e-3, ContactThresholds{kThreshold, 0.01});
    ScanParts parts{
        std::make_shared<ScanClock>(kLayout, taxels, kTimeConstant, kScanRate),
        std::make_shared<CrosstalkCompensator>(layout, share),
        bursts,
        hum,
        integration,
        history,
        finder,
        std::make_shared<ContactTracker>(TrackerSettings{1.5, 0.02, 2e-3, 1e-3, kPitch, kThreshold, kNoise}, 1),
        std::make_shared<DynamicChannel>(layout, kNoise)};
    // One volt for each newton.
    const InverseSignalChain chain{
        -32768.0 / kCountsPerNewton, 1.0 / kCountsPerNewton, 1.0, 0.0, kChargePerNewton, 300, 65200};
    path = std::make_shared<ScanPath>(parts, chain, std::vector<double>(taxels, 1e-9),
                                      InterpolationLimits{5.0 * kNoise, 7.5, 7.5});
    block_end =
        std::make_shared<BlockEnd>(path, BlockParts{estimator, faults, bursts, hum, finder}, 2, 0.2 * kThreshold);
    reconstructor = std::make_unique<Reconstructor>(path, block_end);
    scan.layout = kLayout;
    scan.stamp = 1'700'000'000'000'000'000;
    scan.counts = counts.data();
    scan.taxels = taxels;
    scan.temperatures = temperatures.data();
    scan.sensors = temperatures.size();
  }

  void next(std::int64_t step) {
    ++scan.sequence;
    scan.device_time += step;
    scan.stamp += 1000 * step;
  }

  /// Process the scan by the path alone, and check what is reported.
  void process() {
    if (path->receive(scan) && !path->begin(scan)) {
      integration->inverse().start(path->charge().data());
      ForceIntegration::State& state = integration->state();
      state.correction = state.raw;
      state.force.assign(state.force.size(), 0.0);
      integration->block().started = integration->block().valid = true;
    }
    path->finish();
    check();
  }

  /// Process the scan, and close a block that is due.
  void reconstruct() {
    reconstructor->process(scan);
    check();
    reconstructor->run_maintenance();
    for (std::size_t taxel = 0; taxel < counts.size(); ++taxel) {
      require((faults->status()[taxel] != TaxelStatus::kOk) == faults->faulty()[taxel],
              "a status is not that of a fault");
    }
  }

  void check() {
    const ScanResult& result = path->result();
    const std::vector<std::uint8_t>& message = writer.write(result.stamp, result.sequence, result.valid,
                                                            path->contacts(), path->shows_released(), path->motions());
    require(message.size() > 40, "a message is too short");
    TrackId last = 0;
    for (const Contact& contact : path->contacts()) {
      require(contact.id > last, "ids of contacts do not ascend");
      last = contact.id;
      require(!contact.region.taxels.empty(), "a contact has no taxel");
      for (const Taxel taxel : contact.region.taxels) {
        require(taxel >= 0 && static_cast<std::size_t>(taxel) < counts.size(), "a taxel is outside of the array");
      }
    }
    for (const auto& [id, motion] : path->motions()) {
      require(id <= last, "a motion belongs to no contact");
    }
    require(path->clock().step() > 0.0, "a step is not positive");
  }

  /// What the end of a block sets, with given variances and thresholds by them.
  void end_block(const std::vector<double>& variance) {
    const ForceIntegration::State& state = integration->state();
    finder->thresholds().update(state.force.data(), variance.data(), state.offset_known.data(), kBlock);
    path->set_variance(variance.data());
    integration->start_block(true);
    history->keep(2);
    if (hum->state().filled == hum->scans()) {
      hum->start_window();
    }
  }
};

/// Number of scans of a press, slide, merge, split and release of two fingers.
constexpr std::size_t kRound = 512;

/// The force of two fingers that press, slide, merge, split and release on a taxel [N], at some part of all that.
inline double force_of_fingers(const Board& board, std::size_t taxel, double phase) {
  const double force = phase < 0.8 ? 0.8 : 0.0;
  const double apart = kPitch * (1.5 + 1.4 * std::sin(6.283185307179586 * phase));
  const Point& at = board.finder->grid().position(static_cast<Taxel>(taxel));
  double total = 0.0;
  for (const double side : {-1.0, 1.0}) {
    const double dx = at.x - side * apart;
    const double dy = at.y - 1e-3 * phase;
    total += force * std::exp(-(dx * dx + dy * dy) / (2.0 * 0.9e-3 * 0.9e-3));
  }
  return total;
}

inline std::uint16_t count_of(double newton, std::size_t scan, std::size_t taxel) {
  const double flicker = static_cast<double>((scan * 7 + taxel * 13) % 3) - 1.0;
  return static_cast<std::uint16_t>(32768.0 + std::round(kCountsPerNewton * newton + flicker));
}

/// The scan of two fingers whose touch repeats after `kRound` scans, without leakage.
inline void touch(Board& board, std::size_t number) {
  const std::size_t index = number % kRound;
  const double phase = static_cast<double>(index) / static_cast<double>(kRound);
  for (std::size_t taxel = 0; taxel < board.counts.size(); ++taxel) {
    board.counts[taxel] = count_of(force_of_fingers(board, taxel, phase), index, taxel);
  }
}

/// The same with leakage, a quarter as fast, and after a rest.
inline void leaking_touch(Board& board, std::size_t number) {
  const double phase = std::fmod(0.8 + static_cast<double>(number) / static_cast<double>(4 * kRound), 1.0);
  for (std::size_t taxel = 0; taxel < board.counts.size(); ++taxel) {
    const double force = force_of_fingers(board, taxel, phase);
    board.charge[taxel] =
        std::exp(-1.0 / (kScanRate * kTimeConstant)) * board.charge[taxel] + force - board.force[taxel];
    board.force[taxel] = force;
    board.counts[taxel] = count_of(board.charge[taxel], number, taxel);
  }
}

}  // namespace posfet
