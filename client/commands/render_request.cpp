#include "client/commands/render_request.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstdio>

#include "common/error.h"

namespace itn {
namespace {

// The medium's parameter of this name; PARAMETER_UNSPECIFIED if it has none.
v1::Parameter medium_parameter(const std::string& name) {
  std::string upper = name;
  std::ranges::transform(upper, upper.begin(), [](unsigned char c) { return std::toupper(c); });
  v1::Parameter value = v1::PARAMETER_UNSPECIFIED;
  const bool is_lower = std::ranges::none_of(name, [](unsigned char c) { return std::isupper(c); });
  if (is_lower) v1::Parameter_Parse(upper, &value);
  return value;
}

}  // namespace

void add_derivative(const std::string& name, v1::RenderGradRequest& request) {
  if (const v1::Parameter parameter = medium_parameter(name)) {
    request.add_derivatives(parameter);
  } else if (name.find('[') != std::string::npos) {
    request.add_scene_derivatives(name);
  } else {
    throw Error(ErrorKind::kUsage,
                fmt::format("--derivatives: {} is not one of sigma_t, albedo, g, sigma_a, sigma_s, "
                            "sigma_s_reduced, surface[K].reflectance, light[K].scale",
                            name));
  }
}

std::vector<std::string> in_order_of_reply(std::vector<std::string> names) {
  std::stable_partition(names.begin(), names.end(), [](const std::string& name) {
    return medium_parameter(name) != v1::PARAMETER_UNSPECIFIED;
  });
  return names;
}

void set_film(const std::string& flag, const std::string& size, v1::Film& film) {
  unsigned width = 0;
  unsigned height = 0;
  int used = 0;
  if (std::sscanf(size.c_str(), "%5ux%5u%n", &width, &height, &used) != 2 ||
      used != static_cast<int>(size.size())) {
    throw Error(ErrorKind::kUsage,
                fmt::format("{}: {} is not WIDTHxHEIGHT in pixels, e.g. 128x128", flag, size));
  }
  film.set_width(width);
  film.set_height(height);
}

}  // namespace itn
