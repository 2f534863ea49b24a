// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include <pybind11/pybind11.h>

#include <memory>
#include <utility>

#include "posfet_core/block_end.hpp"
#include "posfet_core/reconstructor.hpp"
#include "python_bindings.hpp"
#include "python_scan.hpp"

namespace posfet {

namespace {

void bind_block_end(const py::module_& module) {
  py::class_<BlockEnd, std::shared_ptr<BlockEnd>>(module, "BlockEnd", "Closes the blocks of one path.")
      .def(py::init([](std::shared_ptr<ScanPath> path, std::shared_ptr<ForceEstimator> estimator,
                       std::shared_ptr<TaxelFaultDetector> faults, std::shared_ptr<BurstDetector> bursts,
                       std::shared_ptr<MainsHum> hum, std::shared_ptr<ContactFinder> finder, Taxel margin,
                       double informative) {
             BlockParts parts{std::move(estimator), std::move(faults), std::move(bursts), std::move(hum),
                              std::move(finder)};
             return std::make_shared<BlockEnd>(std::move(path), std::move(parts), margin, informative);
           }),
           py::kw_only(), py::arg("path"), py::arg("estimator"), py::arg("faults"), py::arg("bursts"), py::arg("hum"),
           py::arg("finder"), py::arg("margin"), py::arg("informative"))
      .def("set_thresholds", &BlockEnd::set_thresholds,
           "Set the contact thresholds by the uncertainty of the forces, and that uncertainty itself.")
      .def("set_hum", &BlockEnd::set_hum, py::arg("hum"), "Use another estimator of the mains hum.")
      .def_readwrite("detects_faults", &BlockEnd::detects_faults, "Whether taxels are tested.");
}

/// Process a scan of Python. Returns whether it was accepted, was unusable, is valid, why not, and the number of
/// saturated taxels.
py::tuple process(Reconstructor& reconstructor, const py::object& object) {
  const PythonScan scan(object);
  reconstructor.process(scan.scan());
  const ScanResult& result = reconstructor.path().result();
  return py::make_tuple(result.accepted, result.unusable, result.valid, static_cast<int>(result.reasons),
                        result.saturated);
}

}  // namespace

void bind_blocks(const py::module_& module) {
  bind_block_end(module);
  py::class_<Reconstructor, std::shared_ptr<Reconstructor>>(module, "Reconstructor",
                                                            "Forces and contacts of one sensor, scan by scan.")
      .def(py::init<std::shared_ptr<ScanPath>, std::shared_ptr<BlockEnd>>(), py::arg("path"), py::arg("block_end"))
      .def("process", &process, py::arg("scan"),
           "Process a scan; return whether it was accepted, unusable, valid, why not, and how many taxels are "
           "saturated.")
      .def("run_maintenance", &Reconstructor::run_maintenance, "Close the block that is due.")
      .def_property_readonly("maintenance_due", &Reconstructor::maintenance_due,
                             "Whether `run_maintenance` has work to do.");
}

}  // namespace posfet
