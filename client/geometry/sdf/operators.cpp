#include "client/geometry/sdf/operators.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "client/geometry/sdf/nodes.h"
#include "client/geometry/sdf/smooth.h"

namespace itn::sdf {
namespace {

// A warp that turns by an angle proportional to a coordinate shears what is at radius r by the
// rate times r. The largest stretch of a shear by s is (s + sqrt(s^2 + 4)) / 2.
float stretch_of_shear(float radians_per_unit) {
  const float shear = std::abs(radians_per_unit) * kReach;
  return (shear + std::sqrt(shear * shear + 4)) / 2;
}

// Sine and cosine to the accuracy that rotations need, in operations that vectorise; |x| < 10.
// (Taylor's polynomial on a quarter of the angle, doubled twice.)
struct SinCos {
  float sin, cos;
};
SinCos sin_cos(float x) {
  const float y = x / 8, y2 = y * y;
  float s = y * (1 - y2 / 6 * (1 - y2 / 20 * (1 - y2 / 42)));
  float c = 1 - y2 / 2 * (1 - y2 / 12 * (1 - y2 / 30 * (1 - y2 / 56)));
  for (int doubling = 0; doubling < 3; ++doubling) {
    const float doubled = 2 * s * c;
    c = 1 - 2 * s * s;
    s = doubled;
  }
  return {s, c};
}

float rounded(float x) {
  return static_cast<float>(static_cast<int>(x + (x < 0 ? -0.5F : 0.5F)));
}

}  // namespace

Solid united(Solid a, Solid b, float fillet) {
  if (fillet <= 0) {
    return combined(std::move(a), std::move(b), [](float d, float e) { return std::min(d, e); });
  }
  return combined(std::move(a), std::move(b),
                  [fillet](float d, float e) { return smooth_min(d, e, fillet); });
}

Solid intersected(Solid a, Solid b, float fillet) {
  if (fillet <= 0) {
    return combined(std::move(a), std::move(b), [](float d, float e) { return std::max(d, e); });
  }
  return combined(std::move(a), std::move(b),
                  [fillet](float d, float e) { return smooth_max(d, e, fillet); });
}

Solid subtracted(Solid a, Solid b, float fillet) {
  if (fillet <= 0) {
    return combined(std::move(a), std::move(b), [](float d, float e) { return std::max(d, -e); });
  }
  return combined(std::move(a), std::move(b),
                  [fillet](float d, float e) { return smooth_max(d, -e, fillet); });
}

Solid grown(Solid solid, float by) {
  return changed(std::move(solid), [by](float d, Vec3f) { return d - by; });
}

Solid hollowed(Solid solid, float thickness) {
  return changed(std::move(solid),
                 [half = thickness / 2](float d, Vec3f) { return std::abs(d + half) - half; });
}

Solid displaced(Solid solid, Waves waves) {
  const float scale = 1 / (1 + slope_bound(waves));
  return changed(std::move(solid), [waves = std::move(waves), scale](float d, Vec3f p) {
    return (d - sum(waves, p)) * scale;
  });
}

Solid creased(Solid solid, Waves waves) {
  const float scale = 1 / (1 + slope_bound(waves));
  return changed(std::move(solid), [waves = std::move(waves), scale](float d, Vec3f p) {
    return (d + std::abs(sum(waves, p))) * scale;
  });
}

Solid moved(Solid solid, Vec3f by) {
  return warped(std::move(solid), [by](Vec3f p) { return p - by; });
}

Solid turned(Solid solid, const Rotation<float>& rotation) {
  return warped(std::move(solid), rotation.inverse());
}

Solid scaled(Solid solid, float by) {
  return warped(
      std::move(solid), [per = 1 / by](Vec3f p) { return p * per; }, by);
}

Solid stretched(Solid solid, Vec3f by) {
  const Vec3f per{1 / by.x, 1 / by.y, 1 / by.z};
  return warped(
      std::move(solid),
      [per](Vec3f p) {
        return Vec3f{p.x * per.x, p.y * per.y, p.z * per.z};
      },
      std::min({by.x, by.y, by.z}));
}

Solid elongated(Solid solid, Vec3f by) {
  const auto off = [](float x, float half) { return x - std::min(std::max(x, -half), half); };
  return warped(std::move(solid), [by, off](Vec3f p) {
    return Vec3f{off(p.x, by.x), off(p.y, by.y), off(p.z, by.z)};
  });
}

Solid mirrored(Solid solid) {
  return warped(std::move(solid), [](Vec3f p) { return Vec3f{std::abs(p.x), p.y, p.z}; });
}

Solid repeated_around(Solid solid, int count) {
  std::vector<std::pair<float, float>> directions;
  for (int k = 0; k < count; ++k) {
    const double angle = 2 * std::numbers::pi * k / count;
    directions.emplace_back(static_cast<float>(std::cos(angle)),
                            static_cast<float>(std::sin(angle)));
  }
  return warped(std::move(solid), [directions = std::move(directions)](Vec3f p) {
    // In the coordinates of the nearest direction: that with the largest component along it.
    float along = -2 * kReach * kReach, across = 0;
    for (const auto& [c, s] : directions) {
      const float component = p.x * c + p.z * s;
      const bool nearer = component > along;
      across = nearer ? p.z * c - p.x * s : across;
      along = nearer ? component : along;
    }
    return Vec3f{along, p.y, std::abs(across)};
  });
}

Solid repeated_along(Solid solid, float spacing, int count) {
  const auto last = static_cast<float>(count);
  return warped(std::move(solid), [spacing, last, per = 1 / spacing](Vec3f p) {
    const float nearest = std::min(std::max(rounded(p.x * per), -last), last);
    return Vec3f{p.x - spacing * nearest, p.y, p.z};
  });
}

Solid twisted(Solid solid, float radians_per_unit) {
  return warped(
      std::move(solid),
      [radians_per_unit](Vec3f p) {
        const auto [s, c] = sin_cos(radians_per_unit * p.y);
        return Vec3f{c * p.x + s * p.z, p.y, c * p.z - s * p.x};
      },
      1 / stretch_of_shear(radians_per_unit));
}

Solid bent(Solid solid, float radians_per_unit) {
  return warped(
      std::move(solid),
      [radians_per_unit](Vec3f p) {
        const auto [s, c] = sin_cos(radians_per_unit * p.x);
        return Vec3f{c * p.x - s * p.y, s * p.x + c * p.y, p.z};
      },
      1 / stretch_of_shear(radians_per_unit));
}

Solid tapered(Solid solid, float taper) {
  // Beyond the reach the widening stops. It stretches across by up to e^(|taper| reach), and shears
  // by |taper| times that times the radius.
  const float most = std::exp(std::abs(taper) * kReach);
  const float stretch = most * (1 + std::abs(taper) * kReach);
  return warped(
      std::move(solid),
      [taper](Vec3f p) {
        const float widening = std::exp(taper * std::min(std::max(p.y, -kReach), kReach));
        return Vec3f{p.x * widening, p.y, p.z * widening};
      },
      1 / stretch);
}

Solid wobbling(Solid solid, Waves x, Waves y, Waves z) {
  const Vec3f slopes{slope_bound(x), slope_bound(y), slope_bound(z)};
  return warped(
      std::move(solid),
      [x = std::move(x), y = std::move(y), z = std::move(z)](Vec3f p) {
        return p + Vec3f{sum(x, p), sum(y, p), sum(z, p)};
      },
      1 / (1 + length(slopes)));
}

}  // namespace itn::sdf
