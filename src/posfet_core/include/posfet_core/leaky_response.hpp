// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Response of a charge that leaks to its sources, and the columns of a linear fit of it: exact for sources that are
/// linear between scans.
#pragma once

#include <cstddef>

namespace posfet {

/// Sources in consecutive scans, a row for each.
struct Course {
  const double* time;  ///< [s], ascending
  const double* source;
  std::size_t scans;
  std::size_t columns;
};

/// What a charge y with dy/dt = du/dt - y/tau has of its sources u, from no charge at the first scan.
void high_pass(const Course& course, double time_constant, double* response);

/// A lag y behind its sources u with dy/dt = (u - y)/tau, from 0 at the first scan.
void low_pass(const Course& course, double time_constant, double* response);

/// The distance F - P of forces from play operators, which begin at 0 and are never further than their half width from
/// them.
void play_distance(const double* force, std::size_t scans, std::size_t columns, double half_width, double* distance);

/// The charge of a taxel as the last iteration of a fit has it.
struct LeakyCharge {
  double time_constant;        ///< [s]
  const double* coefficients;  ///< of the sources
  double start;                ///< charge at the first scan
  std::size_t first_signal;    ///< the first source that has leaked already,
  std::size_t end_of_signals;  ///< and the first one after them that has not
};

/// The means of blocks of scans of the responses to all sources, of the derivative of the charge by the rate of the
/// leakage, and of what is left of a charge of 1 at the first scan: rows of columns + 2; an incomplete last block is
/// left out.
void fit_columns(const Course& course, const LeakyCharge& charge, std::size_t block, double* means);

}  // namespace posfet
