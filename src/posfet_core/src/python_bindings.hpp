// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Parts of the Python module posfet_core.scan_path, each defined in a file of its own.
#pragma once

#include <pybind11/pybind11.h>

namespace posfet {

/// Charges and forces of a scan: scan clock, crosstalk, bursts, integration, history of the counts.
void bind_scan_parts(pybind11::module_& module);

/// Mains hum.
void bind_hum(const pybind11::module_& module);

/// Tests of the taxels.
void bind_faults(const pybind11::module_& module);

/// The whole path, and the serialised message.
void bind_scan_path(const pybind11::module_& module);

/// Belief and filter of the force errors, at the end of every block.
void bind_estimation(const pybind11::module_& module);

/// What the estimator of static force is made of.
void bind_estimation_parts(pybind11::module_& module);

/// The end of a block, and the order of scans and blocks.
void bind_blocks(const pybind11::module_& module);

/// What takes scans without Python, and the mutex that it shares with Python.
void bind_sink(const pybind11::module_& module);

}  // namespace posfet
