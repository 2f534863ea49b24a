// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What happens at the end of a block (20 ms), in its order: the taxels are tested, the hum is estimated, baselines are
/// corrected away from contacts, and the thresholds are set by the new uncertainty.
#pragma once

#include <memory>
#include <vector>

#include "posfet_core/bursts.hpp"
#include "posfet_core/detection.hpp"
#include "posfet_core/estimation/force_estimator.hpp"
#include "posfet_core/flags.hpp"
#include "posfet_core/grid.hpp"
#include "posfet_core/mains_hum.hpp"
#include "posfet_core/scan_path.hpp"
#include "posfet_core/taxel_faults.hpp"

namespace posfet {

/// What a block changes besides its path, each shared with the caller.
struct BlockParts {
  std::shared_ptr<ForceEstimator> estimator;
  std::shared_ptr<TaxelFaultDetector> faults;
  std::shared_ptr<BurstDetector> bursts;
  std::shared_ptr<MainsHum> hum;
  std::shared_ptr<ContactFinder> finder;
};

/// Closes the blocks of one path.
class BlockEnd {
public:
  /// `margin` is the distance from a contact up to which taxels are near it [taxels]; `informative` the greatest
  /// standard deviation of a noisy taxel whose readings are still informative [N]. Throws std::invalid_argument where
  /// parts are of different arrays, or missing.
  BlockEnd(std::shared_ptr<ScanPath> path, BlockParts parts, Taxel margin, double informative);

  /// Whether a block has lasted for its duration.
  bool due() const { return parts_.estimator->block_time() >= kBlock; }

  /// Close the block.
  void close();

  /// Start with the scan that the path has begun, which has no predecessor.
  void start();

  /// Set the contact thresholds by the uncertainty of the forces, and that uncertainty itself.
  void set_thresholds();

  /// Use another estimator of the mains hum, of the same array.
  void set_hum(std::shared_ptr<MainsHum> hum);

  /// Whether taxels are tested; the noise of all is measured in any case.
  bool detects_faults = true;

private:
  void test_taxels(const Mask& near);
  void close_hum();
  void close_estimator();
  void choose_interpolated();
  void update_thresholds(double duration);

  std::shared_ptr<ScanPath> path_;
  BlockParts parts_;
  Taxel margin_;
  double informative_;
  TaxelFlags touched_;  ///< Taxels in contact at any time of the block.
  TaxelFlags flags_;    ///< Of the step that runs.
  std::vector<double> mean_;
  std::vector<double> variance_;
  std::vector<double> charge_;
  Vector<const Taxels*> contacts_;
};

}  // namespace posfet
