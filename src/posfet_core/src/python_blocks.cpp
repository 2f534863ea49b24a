// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <algorithm>
#include <memory>
#include <utility>

#include "posfet_core/block_end.hpp"
#include "posfet_core/reconstructor.hpp"
#include "python_arrays.hpp"
#include "python_bindings.hpp"
#include "python_scan.hpp"

namespace posfet {

namespace {

/// The estimator of posfet_model/estimation/force_estimator.py, called by a thread with or without the interpreter.
class PythonForceEstimator final : public ForceEstimator {
public:
  PythonForceEstimator(py::object estimator, std::shared_ptr<ForceIntegration> integration, double duration)
      : estimator_(std::move(estimator)),
        integration_(std::move(integration)),
        duration_(duration),
        informative_(integration_->taxels()) {}

  std::size_t taxels() const override { return integration_->taxels(); }
  ForceIntegration& integration() override { return *integration_; }
  const ForceIntegration& integration() const override { return *integration_; }
  double block_duration() const override { return duration_; }
  TaxelFlags& informative() override { return informative_; }

  std::size_t restarts() const override {
    const py::gil_scoped_acquire interpreter;
    return py::cast<std::size_t>(estimator_.attr("restarts"));
  }

  void start(const double* charge) override {
    const py::gil_scoped_acquire interpreter;
    estimator_.attr("start")(array(charge));
  }

  void interrupt() override {
    const py::gil_scoped_acquire interpreter;
    estimator_.attr("interrupt")();
  }

  void close_block(const bool* touched, const std::vector<const Taxels*>& contacts) override {
    const py::gil_scoped_acquire interpreter;
    py::list listed;
    for (const Taxels* taxels : contacts) {
      listed.append(array_of(*taxels));
    }
    estimator_.attr("informative") = array(informative_.data());
    estimator_.attr("close_block")(array(touched), listed);
  }

  void ignore(const bool* faulty) override {
    const py::gil_scoped_acquire interpreter;
    estimator_.attr("ignore")(array(faulty));
  }

  void set_noise_variance(const double* variance) override {
    const py::gil_scoped_acquire interpreter;
    estimator_.attr("set_noise_variance")(array(variance));
  }

  void block_mean(double* out) const override {
    const py::gil_scoped_acquire interpreter;
    copy(estimator_.attr("block_mean"), out);
  }

  void residual_charge(double* out) const override {
    const py::gil_scoped_acquire interpreter;
    copy(estimator_.attr("residual_charge"), out);
  }

  void force_variance(double* out) const override {
    const py::gil_scoped_acquire interpreter;
    copy(estimator_.attr("force_variance")(py::array_t<double>(count())), out);
  }

  void variance(double* out) const override {
    const py::gil_scoped_acquire interpreter;
    copy(estimator_.attr("variance")(py::array_t<double>(count())), out);
  }

  void tare(bool forced, double* change) override {
    const py::gil_scoped_acquire interpreter;
    copy(estimator_.attr("tare")(forced), change);
  }

private:
  py::ssize_t count() const { return static_cast<py::ssize_t>(taxels()); }

  template <typename Value>
  py::array_t<Value> array(const Value* values) const {
    return py::array_t<Value>(count(), values);
  }

  static void copy(const py::object& object, double* out) {
    const auto values = py::cast<Values>(object);
    std::copy(values.data(), values.data() + values.size(), out);
  }

  py::object estimator_;
  std::shared_ptr<ForceIntegration> integration_;
  double duration_;
  TaxelFlags informative_;
};

void bind_block_end(const py::module_& module) {
  const py::class_<ForceEstimator, std::shared_ptr<ForceEstimator>> base(module, "ForceEstimator",
                                                                         "Forces of all taxels.");
  py::class_<PythonForceEstimator, ForceEstimator, std::shared_ptr<PythonForceEstimator>>(
      module, "PythonForceEstimator", "An estimator in Python.")
      .def(py::init<py::object, std::shared_ptr<ForceIntegration>, double>(), py::arg("estimator"),
           py::arg("integration"), py::arg("duration"));
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
