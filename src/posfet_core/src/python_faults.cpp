// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <memory>
#include <utility>

#include "posfet_core/taxel_faults.hpp"
#include "posfet_core/telegraph_noise.hpp"
#include "python_arrays.hpp"
#include "python_bindings.hpp"

namespace posfet {

namespace {

Taxel count_of(const TaxelFaultDetector& detector) { return static_cast<Taxel>(detector.taxels()); }

bool test_block(TaxelFaultDetector& detector, double duration, const Values& force, const Values& variance,
                const Values& charge, const Tested& saturated, const Tested& touched, const Tested& offset_known) {
  const Taxel taxels = count_of(detector);
  require_taxels(saturated, taxels, "saturated");
  require_taxels(offset_known, taxels, "offset_known");
  return detector.close_block({duration, values_of(force, taxels, "force"), values_of(variance, taxels, "variance"),
                               values_of(charge, taxels, "charge"), saturated.data(), offset_known.data()},
                              mask_of(touched, taxels, "touched"));
}

void measure_noise(TaxelFaultDetector& detector, double duration, const Tested& saturated, const Tested& touched) {
  require_taxels(saturated, count_of(detector), "saturated");
  detector.measure_noise(duration, saturated.data(), mask_of(touched, count_of(detector), "touched"));
}

py::array_t<bool> informative(TaxelFaultDetector& detector, double deviation) {
  py::array_t<bool> found(count_of(detector));
  detector.find_informative(deviation, found.mutable_data());
  return found;
}

/// The status of each taxel, a writable view.
py::array status_of(const py::object& self) {
  auto& detector = self.cast<TaxelFaultDetector&>();
  auto* const status = reinterpret_cast<std::uint8_t*>(detector.status().data());  // of that type, by its definition
  return view_of(status, {count_of(detector)}, self);
}

void bind_detector(const py::module_& module) {
  py::class_<TaxelFigures>(module, "TaxelFigures", "What the description of a sensor says of its taxels.")
      .def(py::init([](double threshold, double release_threshold, double noise, double newton_per_count,
                       double force_max, double time_constant, double longest_run, bool coarse, bool spread_by_skin) {
             return TaxelFigures{threshold,     release_threshold, noise,  newton_per_count, force_max,
                                 time_constant, longest_run,       coarse, spread_by_skin};
           }),
           py::kw_only(), py::arg("threshold"), py::arg("release_threshold"), py::arg("noise"),
           py::arg("newton_per_count"), py::arg("force_max"), py::arg("time_constant"), py::arg("longest_run"),
           py::arg("coarse"), py::arg("spread_by_skin"));
  py::class_<TaxelFaultDetector, std::shared_ptr<TaxelFaultDetector>>(module, "TaxelFaultDetector",
                                                                      "Tests the taxels of one array block by block.")
      .def(py::init([](const SkinResponse& skin, const TaxelFigures& figures, const Flags& known_dead) {
             return std::make_shared<TaxelFaultDetector>(skin, figures,
                                                         flags_of(known_dead, skin.grid().taxels(), "known_dead"));
           }),
           py::arg("skin"), py::arg("figures"), py::arg("known_dead") = py::none())
      .def("close_block", &test_block, py::arg("duration"), py::arg("force"), py::arg("variance"), py::arg("charge"),
           py::arg("saturated"), py::arg("touched"), py::arg("offset_known"),
           "End a block: test all taxels; return whether the set of faulty ones changed.")
      .def("measure_noise", &measure_noise, py::arg("duration"), py::arg("saturated"), py::arg("touched"),
           "End a block without a test: measure the noise of all taxels.")
      .def("informative", &informative, py::arg("deviation"),
           "Return the noisy taxels with at most that noise [N] whose readings are still informative.")
      .def_property_readonly("history", &TaxelFaultDetector::history, "Counts of the last scans.")
      .def_property_readonly("status", &status_of, "Status of each taxel, values of TaxelStatus.")
      .def_property_readonly(
          "faulty", [](const py::object& self) { return view_of(self.cast<TaxelFaultDetector&>().faulty(), self); },
          "Taxels whose signal is meaningless.")
      .def_property_readonly("any_faulty", &TaxelFaultDetector::any_faulty, "Whether a taxel is faulty.")
      .def_property_readonly(
          "usual_change",
          [](const py::object& self) { return view_of(self.cast<TaxelFaultDetector&>().usual_change(), self); },
          "Median difference of two consecutive changes of each taxel [N]; read-only.")
      .def_property_readonly(
          "noise_variance",
          [](const py::object& self) { return view_of(self.cast<TaxelFaultDetector&>().noise_variance(), self); },
          "Variance of a reading of each taxel [N2]: measured if loud, else as described; read-only.");
  module.attr("INFORMATIVE") = kInformative;
  module.attr("DEAD_SHARE") = kDeadShare;
}

void bind_telegraph(const py::module_& module) {
  py::class_<TelegraphDetector>(module, "TelegraphDetector", "Finds the taxels that switch between two levels.")
      .def(py::init<const SkinResponse&, double>(), py::arg("skin"), py::arg("time_constant"))
      .def(
          "close_block",
          [](TelegraphDetector& detector, const Values& mean, const Values& variance, const Tested& sound,
             double duration, bool touched) {
            const auto taxels = static_cast<Taxel>(detector.taxels());
            require_taxels(sound, taxels, "sound");
            detector.close_block(values_of(mean, taxels, "mean"), values_of(variance, taxels, "variance"), sound.data(),
                                 duration, touched);
          },
          py::arg("mean"), py::arg("variance"), py::arg("sound"), py::arg("duration"), py::arg("touched"),
          "Process a block.")
      .def_property_readonly(
          "found", [](const py::object& self) { return view_of(self.cast<TelegraphDetector&>().found(), self); },
          "Taxels with telegraph noise.");
  module.attr("RETURN_MEMORY") = kReturnMemory;
}

}  // namespace

void bind_faults(const py::module_& module) {
  bind_detector(module);
  bind_telegraph(module);
}

}  // namespace posfet
