// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/separation.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>

namespace posfet {

namespace {

/// Added to the initial force of each component [N], whose logarithm is taken: to some no taxel may be nearest.
constexpr double kLeastForce = 1e-9;

}  // namespace

Mixture::Mixture(const Grid& grid, double spread, double threshold) : grid_(grid), threshold_(threshold) {
  const Layout& layout = grid.layout();
  width_ = {spread * spread + layout.pitch_x * layout.pitch_x / 12.0,
            spread * spread + layout.pitch_y * layout.pitch_y / 12.0};
}

std::optional<Shares> Mixture::shares(const Vector<Point>& positions, const Taxels& members,
                                      const Vector<double>& weight, int iterations) const {
  Vector<Component> components = initial(positions, members, weight);
  for (int iteration = 0; iteration < iterations; ++iteration) {
    components = updated(components, members, weight);
    if (components.size() < 2) {
      return std::nullopt;
    }
  }
  merge_close(components);
  if (components.size() < 2) {
    return std::nullopt;
  }
  return responsibilities(members, components);
}

/// Components at given positions, each with the force of the members nearest to it.
Vector<Mixture::Component> Mixture::initial(const Vector<Point>& positions, const Taxels& members,
                                            const Vector<double>& weight) const {
  Vector<Component> components;
  components.reserve(positions.size());
  for (const Point& position : positions) {
    components.push_back({1.0, position});
  }
  const Shares density = log_density(members, components);
  for (Component& component : components) {
    component.force = 0.0;
  }
  for (std::size_t member = 0; member < members.size(); ++member) {
    std::size_t nearest = 0;
    for (std::size_t other = 1; other < components.size(); ++other) {
      nearest = density[other][member] > density[nearest][member] ? other : nearest;
    }
    components[nearest].force += weight[member];
  }
  for (Component& component : components) {
    component.force += kLeastForce;
  }
  return components;
}

/// One iteration: force and centre of each component's share, without components below the contact threshold.
Vector<Mixture::Component> Mixture::updated(const Vector<Component>& components, const Taxels& members,
                                            const Vector<double>& weight) const {
  Vector<Component> found;
  for (const Vector<double>& share : responsibilities(members, components)) {
    double mass = 0.0, x = 0.0, y = 0.0;
    for (std::size_t member = 0; member < members.size(); ++member) {
      const Point& at = grid_.position(members[member]);
      mass += share[member] * weight[member];
      x += share[member] * (at.x * weight[member]);
      y += share[member] * (at.y * weight[member]);
    }
    if (mass >= threshold_) {
      found.push_back({mass, {x / mass, y / mass}});
    }
  }
  return found;
}

/// Remove the weaker one of every two components that are too close to each other.
void Mixture::merge_close(Vector<Component>& components) const {
  const double least = kLeastDistance * grid_.largest_pitch();
  const auto order = [](const Component& component) {
    return std::make_tuple(component.force, component.at.x, component.at.y);
  };
  while (components.size() > 1) {
    std::size_t first = 0, second = 1;
    double nearest = HUGE_VAL;
    for (std::size_t one = 0; one < components.size(); ++one) {
      for (std::size_t other = one + 1; other < components.size(); ++other) {
        const double distance =
            std::hypot(components[one].at.x - components[other].at.x, components[one].at.y - components[other].at.y);
        if (distance < nearest) {
          std::tie(first, second, nearest) = std::make_tuple(one, other, distance);
        }
      }
    }
    if (nearest >= least) {
      return;
    }
    const std::size_t weaker = order(components[second]) < order(components[first]) ? second : first;
    components.erase(components.begin() + static_cast<std::ptrdiff_t>(weaker));
  }
}

/// ln(force*exp(-distance^2/(2*width^2))) of each component at each member, without terms that are the same for all
/// components: the rest is linear in x and y.
Shares Mixture::log_density(const Taxels& members, const Vector<Component>& components) const {
  Shares density;
  for (const auto& [force, at] : components) {
    const double constant = std::log(force) - 0.5 * (at.x * at.x / width_.x + at.y * at.y / width_.y);
    const double slope_x = at.x / width_.x;
    const double slope_y = at.y / width_.y;
    Vector<double>& line = density.emplace_back();
    line.reserve(members.size());
    for (const Taxel taxel : members) {
      line.push_back(constant + slope_x * grid_.position(taxel).x + slope_y * grid_.position(taxel).y);
    }
  }
  return density;
}

/// Share of each component in each member.
Shares Mixture::responsibilities(const Taxels& members, const Vector<Component>& components) const {
  Shares shares = log_density(members, components);
  for (std::size_t member = 0; member < members.size(); ++member) {
    double greatest = -HUGE_VAL;
    for (const Vector<double>& share : shares) {
      greatest = std::max(greatest, share[member]);
    }
    double total = 0.0;
    for (Vector<double>& share : shares) {
      share[member] = std::exp(share[member] - greatest);
      total += share[member];
    }
    for (Vector<double>& share : shares) {
      share[member] /= total;
    }
  }
  return shares;
}

}  // namespace posfet
