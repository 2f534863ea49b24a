// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/moments.hpp"

#include <algorithm>
#include <cmath>

#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

double greatest(const std::vector<double>& values) { return *std::max_element(values.begin(), values.end()); }

}  // namespace

Axes principal_axes(double xx, double yy, double xy) {
  const double half = 0.5 * (xx - yy);
  const double mean = 0.5 * (xx + yy);
  const double spread = std::hypot(half, xy);
  const double large = std::sqrt(mean + spread);
  const double small = mean > spread ? std::sqrt(mean - spread) : 0.0;
  // Cosine and sine of half the angle of (half, xy).
  const double longer = spread > 0.0 ? std::sqrt(0.5 + 0.5 * std::abs(half) / spread) : 1.0;
  const double shorter = spread > 0.0 ? 0.5 * xy / (spread * longer) : 0.0;
  const double cosine = half >= 0.0 ? longer : std::abs(shorter);
  const double sine = half >= 0.0 ? shorter : std::copysign(longer, xy);
  return {{large * cosine, large * sine}, {-small * sine, small * cosine}};
}

MomentFinder::MomentFinder(const Grid& grid, double spread) : grid_(grid) {
  const Layout& layout = grid.layout();
  const Point& first = grid.position(0);
  along_x_ = {first.x, layout.pitch_x, spread * spread + layout.pitch_x * layout.pitch_x / 12,
              std::vector<double>(static_cast<std::size_t>(layout.cols))};
  along_y_ = {first.y, layout.pitch_y, spread * spread + layout.pitch_y * layout.pitch_y / 12,
              std::vector<double>(static_cast<std::size_t>(layout.rows))};
}

Moments MomentFinder::of(const Footprint& footprint, const Vector<double>& weight) {
  double total = 0.0, x = 0.0, y = 0.0, xx = 0.0, yy = 0.0, xy = 0.0;
  for (std::size_t member = 0; member < weight.size(); ++member) {
    const Point& at = grid_.position(footprint.members[member]);
    total += weight[member];
    x += weight[member] * at.x;
    y += weight[member] * at.y;
    xx += weight[member] * (at.x * at.x);
    yy += weight[member] * (at.y * at.y);
    xy += weight[member] * (at.x * at.y);
  }
  const Point mean{x / total, y / total};
  const Point variance{std::max(xx / total - mean.x * mean.x, 0.0), std::max(yy / total - mean.y * mean.y, 0.0)};
  Moments found{total, mean, principal_axes(variance.x, variance.y, xy / total - mean.x * mean.y)};
  if (footprint.at_edge) {
    fill_profiles(footprint, weight);
    found.centre = extrapolated_centre(mean, variance);
  }
  return found;
}

void MomentFinder::fill_profiles(const Footprint& footprint, const Vector<double>& weight) {
  std::fill(along_x_.values.begin(), along_x_.values.end(), 0.0);
  std::fill(along_y_.values.begin(), along_y_.values.end(), 0.0);
  for (std::size_t member = 0; member < weight.size(); ++member) {
    const Taxel taxel = footprint.members[member];
    along_x_.values[static_cast<std::size_t>(grid_.col(taxel))] += weight[member];
    along_y_.values[static_cast<std::size_t>(grid_.row(taxel))] += weight[member];
  }
}

/// Centre of two profiles, each extrapolated beyond the edges that truncate it.
///
/// A round contact has the same width along both axes: the width for the extrapolation of one profile is that of the
/// other, extrapolated itself. Where both are truncated, it starts from the profile's own flank.
Point MomentFinder::extrapolated_centre(Point mean, Point variance) const {
  const bool cut_x = is_truncated(along_x_.values);
  const bool cut_y = is_truncated(along_y_.values);
  const Spread inside_x{mean.x, variance.x};
  const Spread inside_y{mean.y, variance.y};
  Spread x = inside_x;
  Spread y = inside_y;
  if (cut_x && cut_y) {
    double curvature_x = flank_curvature(along_x_);
    double curvature_y = flank_curvature(along_y_);
    for (int round = 0; round < kEdgeIterations; ++round) {
      x = extrapolate(along_x_, inside_x, curvature_x);
      y = extrapolate(along_y_, inside_y, curvature_y);
      curvature_x = curvature(along_x_, y.variance);
      curvature_y = curvature(along_y_, x.variance);
    }
  } else if (cut_x) {
    x = extrapolate(along_x_, inside_x, curvature(along_x_, variance.y));
  } else if (cut_y) {
    y = extrapolate(along_y_, inside_y, curvature(along_y_, variance.x));
  }
  return {x.mean, y.mean};
}

/// Whether a profile does not vanish within the array at one end or both.
bool MomentFinder::is_truncated(const std::vector<double>& values) {
  const double least = kTruncatedShare * greatest(values);
  return values.size() > 1 && (values.front() >= least || values.back() >= least);
}

/// Add what an extrapolated profile has beyond its end: `value` there and `before` it, `beyond` the place of the end,
/// `direction` the way out of the array, `fall` the factor on the ratio from value to value.
void MomentFinder::Sums::extend(double value, double before, double beyond, double direction, double fall,
                                double least) {
  if (value < least) {
    return;
  }
  // Not above the last value: a contact centred beyond the edge cannot be distinguished from a stronger one.
  double ratio = std::min(value / (before > least ? before : least) * fall, 1.0);
  for (int step = 0; step < kMostBeyond; ++step) {
    value *= ratio;
    ratio *= fall;
    beyond += direction;
    total += value;
    moment += beyond * value;
    second += beyond * beyond * value;
    if (value < least) {
      return;
    }
  }
}

/// Mean and variance of a profile, extrapolated beyond its truncated ends by a curvature (pitch/width)^2 [1];
/// `inside` are those of its values alone.
MomentFinder::Spread MomentFinder::extrapolate(const Profile& profile, Spread inside, double curvature) {
  const std::vector<double>& values = profile.values;
  const double square = profile.pitch * profile.pitch;
  const double least = kTruncatedShare * greatest(values);
  const double fall = std::exp(-curvature);
  const auto last = static_cast<double>(values.size() - 1);
  const double mean = (inside.mean - profile.first) / profile.pitch;
  const double total = sum(values);
  Sums sums{total, mean * total, (inside.variance / square + mean * mean) * total};
  sums.extend(values.front(), values[1], 0.0, -1.0, fall, least);
  sums.extend(values.back(), values[values.size() - 2], last, 1.0, fall, least);
  const double extended = sums.moment / sums.total;
  // Not beyond the outermost cells.
  const double bounded = std::min(std::max(extended, -0.5), last + 0.5);
  return {profile.first + profile.pitch * bounded, (sums.second / sums.total - extended * extended) * square};
}

/// (pitch/width)^2 [1] along an axis for a variance across it [m2].
double MomentFinder::curvature(const Profile& profile, double variance_across) {
  return profile.pitch * profile.pitch / std::max(variance_across, profile.narrowest);
}

/// (pitch/width)^2 [1] from the last three values of a profile on its truncated side: at least the one with which the
/// profile would be symmetric about its last value.
double MomentFinder::flank_curvature(const Profile& profile) {
  const std::vector<double>& values = profile.values;
  const double most = profile.pitch * profile.pitch / profile.narrowest;
  const std::size_t count = values.size();
  if (count < 3) {
    return most;
  }
  const bool at_end = values.back() >= values.front();
  const double least = 0.5 * kTruncatedShare * greatest(values);
  const double outer = std::max(at_end ? values[count - 3] : values[2], least);
  const double inner = std::max(at_end ? values[count - 2] : values[1], least);
  const double edge = std::max(at_end ? values[count - 1] : values[0], least);
  const double flank = kFlank * std::log(inner * inner / (outer * edge));
  const double mirrored = 2.0 * std::log(edge / inner);
  return std::min(std::max({flank, mirrored, 0.0}), most);
}

}  // namespace posfet
