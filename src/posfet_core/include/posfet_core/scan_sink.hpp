// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.
/// What takes scans in the thread that decodes them, without an interpreter.
///
/// It connects two modules of Python, of which one knows the bus and the other the forces: a capsule with the name
/// `kScanSinkName` holds a pointer to a `ScanSink`, which belongs to the object that the capsule is from.
#pragma once

#include <cstdint>

#include "posfet_core/scan.hpp"

namespace posfet {

/// What has become of a scan.
enum class Taken : std::uint8_t {
  kRefused,  ///< Nothing was done with it: Python has to process it.
  kTaken,
  kLast,  ///< It was taken, and Python has something to do before the next one.
};

/// A function for complete scans, and the object that it is called with.
struct ScanSink {
  void* object = nullptr;
  Taken (*take)(void* object, const Scan& scan) = nullptr;
};

constexpr const char* kScanSinkName = "posfet_core.ScanSink";

}  // namespace posfet
