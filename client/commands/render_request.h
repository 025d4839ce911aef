// What flags of commands say of a render, as parts of its request.
#pragma once

#include <string>
#include <vector>

#include "itn/v1/render.pb.h"
#include "itn/v1/scene.pb.h"

namespace itn {

// A derivative by its name: "sigma_t", ..., or of the scene, as "light[0].scale", which the worker
// knows to read. Throws Error (kUsage) that lists the names.
void add_derivative(const std::string& name, v1::RenderGradRequest& request);

// The names in the order of the reply: those of the medium first.
std::vector<std::string> in_order_of_reply(std::vector<std::string> names);

// `size`: WIDTHxHEIGHT in pixels; `flag` is what it was given by. Throws Error (kUsage).
void set_film(const std::string& flag, const std::string& size, v1::Film& film);

}  // namespace itn
