// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <memory>

#include "posfet_core/hum_filter.hpp"
#include "posfet_core/mains_hum.hpp"
#include "python_arrays.hpp"
#include "python_bindings.hpp"

namespace posfet {

namespace {

template <typename Class, typename Number, Number HumFilter::State::* Member>
void bind_hum_state(Class& bound, const char* name, const char* text) {
  bound.def_property(
      name, [](const HumFilter& hum) { return hum.state().*Member; },
      [](HumFilter& hum, Number value) { hum.state().*Member = value; }, text);
}

}  // namespace

void bind_hum(const py::module_& module) {
  using State = HumFilter::State;
  py::class_<HumFilter, std::shared_ptr<HumFilter>> bound(module, "HumFilter",
                                                          "Subtracts the hum of signals in any unit.");
  using Bound = decltype(bound);
  bound.def(py::init<std::size_t, std::size_t>(), py::arg("taxels"), py::arg("scans"))
      .def(
          "remove",
          [](HumFilter& hum, KeptValues signal, double step) {
            require_taxels(signal, static_cast<Taxel>(hum.taxels()), "signal");
            hum.remove(signal.mutable_data(), step);
          },
          py::arg("signal").noconvert(), py::arg("step"), "Subtract the hum from the signals of a scan, in place.")
      .def("start_window", &HumFilter::start_window, "Begin a new window.")
      .def("clear", &HumFilter::clear, "Subtract nothing from now on.")
      .def_property_readonly("scans", &HumFilter::scans, "Number of scans of a window.")
      .def_property_readonly(
          "filled", [](const HumFilter& hum) { return hum.state().filled; }, "Number of scans in the window.")
      .def_property_readonly(
          "time", [](const HumFilter& hum) { return hum.state().time; }, "Time since the start of the window [s].")
      .def_property_readonly(
          "parts",
          [](const py::object& self) {
            auto& hum = self.cast<HumFilter&>();
            return view_of(hum.parts().data(),
                           {static_cast<py::ssize_t>(kHumOrders.size()), 2, static_cast<py::ssize_t>(hum.taxels())},
                           self);
          },
          "Cosine and sine parts of each taxel's hum, by order.")
      .def_property_readonly(
          "window",
          [](const py::object& self) {
            auto& hum = self.cast<HumFilter&>();
            return view_of(hum.window().data(),
                           {static_cast<py::ssize_t>(hum.scans()), static_cast<py::ssize_t>(hum.taxels())}, self);
          },
          "Signals of the window.")
      .def_property_readonly(
          "times",
          [](const py::object& self) {
            auto& hum = self.cast<HumFilter&>();
            return view_of(hum.times().data(), {static_cast<py::ssize_t>(hum.scans())}, self);
          },
          "Times of its scans since its start [s].");
  bind_hum_state<Bound, bool, &State::present>(bound, "present", "Whether a hum is subtracted.");
  bind_hum_state<Bound, bool, &State::sampling>(bound, "sampling", "Whether the signals of the scans are kept.");
  bind_hum_state<Bound, double, &State::frequency>(bound, "hum_frequency", "Frequency [Hz].");
  bind_hum_state<Bound, double, &State::phase>(bound, "phase", "Phase at the start of the window [rad].");
  py::class_<MainsHum, HumFilter, std::shared_ptr<MainsHum>>(module, "MainsHum",
                                                             "Estimates and subtracts the hum of signals in any unit.")
      .def(py::init([](std::size_t taxels, double rate, double noise) {
             return std::make_shared<MainsHum>(static_cast<std::size_t>(at_least_one(static_cast<py::ssize_t>(taxels))),
                                               rate, noise);
           }),
           py::arg("taxels"), py::arg("rate"), py::arg("noise"))
      .def("forget", &MainsHum::forget, "Forget what was seen of the window that an interruption has ended.")
      .def(
          "close_block",
          [](MainsHum& hum, const Tested& touched, const Tested& ignored, double duration) {
            require_taxels(touched, static_cast<Taxel>(hum.taxels()), "touched");
            require_taxels(ignored, static_cast<Taxel>(hum.taxels()), "ignored");
            hum.close_block(touched.data(), ignored.data(), duration);
          },
          py::arg("touched"), py::arg("ignored"), py::arg("duration"), "End a block of scans.")
      .def_property_readonly("searches", &MainsHum::searches, "Whether the rate suffices to find hum.")
      .def_property_readonly("frequency", &MainsHum::frequency, "Frequency of the hum [Hz]; NaN: no hum.")
      .def_property_readonly("amplitude", &MainsHum::amplitude,
                             "Root mean square of the taxels' amplitudes of the fundamental.");
}

}  // namespace posfet
