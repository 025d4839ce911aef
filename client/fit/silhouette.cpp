#include "client/fit/silhouette.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

namespace itn {
namespace {

// `covers`: of a pixel.
template <typename Covers>
SilhouetteMoments moments_where(int side, const Covers& covers) {
  double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0, syy = 0;
  for (int row = 0; row < side; ++row) {
    for (int column = 0; column < side; ++column) {
      if (!covers(column, row)) continue;
      const double x = column + 0.5, y = row + 0.5;
      n += 1;
      sx += x;
      sy += y;
      sxx += x * x;
      sxy += x * y;
      syy += y * y;
    }
  }
  if (n == 0) return {};
  const double x = sx / n, y = sy / n;
  // Rows go down, angles up. A pixel by itself has a width.
  const double xx = sxx / n - x * x + 1.0 / 12, yy = syy / n - y * y + 1.0 / 12,
               xy = -(sxy / n - x * y);
  const double middle = (xx + yy) / 2, half = std::hypot((xx - yy) / 2, xy);
  return {n, x, y, std::atan2(2 * xy, xx - yy) / 2, std::sqrt((middle + half) / (middle - half))};
}

double mean_distance(std::span<const double> values, double from) {
  if (values.empty()) return std::numeric_limits<double>::infinity();
  double sum = 0;
  for (const double value : values) sum += std::abs(value - from);
  return sum / static_cast<double>(values.size());
}

}  // namespace

Vec3d PinholeView::direction(double x, double y) const {
  return {(x - center_x) / focal, (center_y - y) / focal, -1};
}

PinholeView PinholeView::at_side(int other) const {
  const double by = static_cast<double>(other) / side;
  return {focal * by, center_x * by, center_y * by, other};
}

Silhouette::Silhouette(const Mesh& mesh, const Pose& pose, const PinholeView& view)
    : pose_(pose),
      view_(view),
      depth_(static_cast<size_t>(view.side) * static_cast<size_t>(view.side),
             std::numeric_limits<float>::infinity()),
      triangle_(depth_.size()) {
  struct Projected {
    double x, y, inverse_depth;  // 0: behind the camera
  };
  std::vector<Projected> projected;
  projected.reserve(mesh.vertices.size());
  for (const Vec3f& vertex : mesh.vertices) {
    const Vec3d p = pose.to_scene(static_cast<Vec3d>(vertex));
    const double inverse = p.z < 0 ? -1 / p.z : 0;
    projected.push_back({view.center_x + view.focal * p.x * inverse,
                         view.center_y - view.focal * p.y * inverse, inverse});
  }
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto& [i, j, k] = mesh.triangles[t];
    const Projected &a = projected[i], &b = projected[j], &c = projected[k];
    if (!(a.inverse_depth > 0 && b.inverse_depth > 0 && c.inverse_depth > 0)) continue;
    const double doubled = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    if (doubled >= 0) continue;  // seen from inside, as rows go down: others cover it
    const auto first = [](double least) { return std::max(0.0, std::ceil(least - 0.5)); };
    const double end = view.side;
    const auto x0 = static_cast<int>(std::min(end, first(std::min({a.x, b.x, c.x})))),
               y0 = static_cast<int>(std::min(end, first(std::min({a.y, b.y, c.y}))));
    const auto last = [&](double most) { return std::min(end - 1, std::floor(most - 0.5)); };
    const auto x1 = static_cast<int>(std::max(-1.0, last(std::max({a.x, b.x, c.x})))),
               y1 = static_cast<int>(std::max(-1.0, last(std::max({a.y, b.y, c.y}))));
    for (int row = y0; row <= y1; ++row) {
      for (int column = x0; column <= x1; ++column) {
        const double x = column + 0.5, y = row + 0.5;
        const double in_b = ((x - a.x) * (c.y - a.y) - (y - a.y) * (c.x - a.x)) / doubled;
        const double in_c = ((b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x)) / doubled;
        if (in_b < 0 || in_c < 0 || in_b + in_c > 1) continue;
        const double inverse = a.inverse_depth + in_b * (b.inverse_depth - a.inverse_depth) +
                               in_c * (c.inverse_depth - a.inverse_depth);
        const size_t pixel = index(column, row);
        const auto depth = static_cast<float>(1 / inverse);
        if (depth >= depth_[pixel]) continue;
        depth_[pixel] = depth;
        triangle_[pixel] = static_cast<uint32_t>(t);
      }
    }
  }
}

bool Silhouette::are_level(int x, int y, int other_x, int other_y) const {
  // Where the depth changes by so many times what the place does to the side, a surface is seen
  // along itself, or ends before another.
  constexpr double kSteep = 8;
  return std::abs(depth(other_x, other_y) - depth(x, y)) < kSteep * depth(x, y) / view_.focal;
}

bool Silhouette::covers_square(int left, int top, int side) const {
  for (int y = top - 1; y <= top + side; ++y) {
    for (int x = left - 1; x <= left + side; ++x) {
      if (x < 0 || y < 0 || x >= view_.side || y >= view_.side || !covers(x, y)) return false;
    }
  }
  return true;
}

bool Silhouette::shows_one_surface(int left, int top, int side) const {
  if (!covers_square(left, top, side)) return false;
  for (int y = top - 1; y <= top + side; ++y) {
    for (int x = left - 1; x <= left + side; ++x) {
      if (x < left + side && !are_level(x, y, x + 1, y)) return false;
      if (y < top + side && !are_level(x, y, x, y + 1)) return false;
    }
  }
  return true;
}

std::vector<ContourPoint> Silhouette::contour() const {
  std::vector<ContourPoint> points;
  const int side = view_.side;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      if (!covers(x, y)) continue;
      for (const auto& [dx, dy] : kBeside) {
        // What the image's edge cuts off is no contour.
        if (std::min(x + dx, y + dy) < 0 || std::max(x + dx, y + dy) >= side) continue;
        if (covers(x + dx, y + dy)) continue;
        const double between_x = x + 0.5 + 0.5 * dx, between_y = y + 0.5 + 0.5 * dy;
        points.push_back({between_x, between_y,
                          pose_.to_object(view_.direction(between_x, between_y) * depth(x, y))});
      }
    }
  }
  return points;
}

Vec3d Silhouette::normal(const Mesh& mesh, int x, int y) const {
  const auto& [i, j, k] = mesh.triangles[triangle_[index(x, y)]];
  const auto corner = [&](uint32_t v) { return static_cast<Vec3d>(mesh.vertices[v]); };
  return pose_.rotation(normalize(cross(corner(j) - corner(i), corner(k) - corner(i))));
}

double Silhouette::overlap(const std::vector<float>& mask) const {
  size_t both = 0, either = 0;
  for (size_t p = 0; p < depth_.size(); ++p) {
    const bool here = depth_[p]<std::numeric_limits<float>::infinity(), there = mask[p]> 0.5F;
    both += here && there ? 1 : 0;
    either += here || there ? 1 : 0;
  }
  return either > 0 ? static_cast<double>(both) / static_cast<double>(either) : 0;
}

std::vector<double> Silhouette::differences(const Silhouette& other) const {
  std::vector<double> differences;
  for (size_t p = 0; p < depth_.size(); ++p) {
    const double difference = double{depth_[p]} - double{other.depth_[p]};
    if (std::isfinite(difference)) differences.push_back(difference);
  }
  return differences;
}

double Silhouette::depth_difference(const Silhouette& other) const {
  return mean_distance(differences(other), 0);
}

double Silhouette::relief_difference(const Silhouette& other) const {
  std::vector<double> differences = this->differences(other);
  if (differences.empty()) return std::numeric_limits<double>::infinity();
  const auto middle = differences.begin() + static_cast<ptrdiff_t>(differences.size() / 2);
  std::ranges::nth_element(differences, middle);
  return mean_distance(differences, *middle);
}

SilhouetteMoments Silhouette::moments() const {
  return moments_where(view_.side, [this](int x, int y) { return covers(x, y); });
}

SilhouetteMoments moments_of(const std::vector<float>& mask, int side) {
  return moments_where(side, [&](int x, int y) {
    return mask[static_cast<size_t>(y) * static_cast<size_t>(side) + static_cast<size_t>(x)] > 0.5F;
  });
}

}  // namespace itn
