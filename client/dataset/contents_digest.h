// Whether an image of a dataset is as it was written.
#pragma once

#include <string>

#include "common/image/image.h"

namespace itn {

// Of all pixels and all entries of the header, but for attribute::kContents, which says this.
std::string contents_digest(const Image& image);

}  // namespace itn
