// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Forces and contacts of one sensor: scan by scan, and what is done between two scans at the end of a block.
#pragma once

#include <memory>
#include <utility>

#include "posfet_core/block_end.hpp"
#include "posfet_core/scan.hpp"
#include "posfet_core/scan_path.hpp"

namespace posfet {

/// Owns the order of the scans and of the ends of blocks. One thread at a time.
class Reconstructor {
public:
  Reconstructor(std::shared_ptr<ScanPath> path, std::shared_ptr<BlockEnd> block_end)
      : path_(std::move(path)), block_end_(std::move(block_end)) {}

  /// Process a scan, after the end of a block that is due; return false for a duplicate or late one, which is refused.
  bool process(const Scan& scan);

  /// Whether `run_maintenance` has work to do.
  bool maintenance_due() const { return block_end_->due(); }

  /// Close the block that is due now, after the results of a scan were published, instead of before the next scan.
  void run_maintenance();

  const ScanPath& path() const { return *path_; }

private:
  std::shared_ptr<ScanPath> path_;
  std::shared_ptr<BlockEnd> block_end_;
};

}  // namespace posfet
