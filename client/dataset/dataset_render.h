// Rendering a planned dataset into a folder.
#pragma once

#include <filesystem>
#include <functional>
#include <stop_token>

#include "client/dataset/dataset.h"
#include "client/dataset/item_render.h"
#include "client/dataset/plan.h"
#include "client/render_pool/render_pool.h"

namespace itn {

struct DatasetProgress {
  size_t done = 0;  // images in the folder
  size_t total = 0;
  size_t kept = 0;  // of `done`, those that were there before
  // By the renders of this call.
  uint64_t paths = 0;
  uint64_t dropped = 0;  // of them: invalid samples and leaks
};

// Throws Error (invalid input) that says what differs unless the dataset in the folder has this
// configuration, or would have it with more images.
void require_same_config(const v1::Dataset& existing, const v1::DatasetConfig& wanted,
                         const std::filesystem::path& folder);

// The images that `derivatives` in DatasetConfig asks for, beside those that the job has.
void ask_for_derivatives(RenderJob& job);

// Writes shapes and manifest, then renders what is missing. An image that is there and whole is
// kept, so that a call that was interrupted or killed is continued by the next; images do not
// depend on what was rendered when. A dataset that is there may be given more images: its own are
// kept. `report` is called before the first image and after each.
//
// Throws Error: kInvalidInput if the folder holds a dataset of another configuration (says what
// differs) or other files; kIo if another process renders there; kCancelled soon after a stop is
// requested; and as RenderPool.
DatasetProgress render_dataset(DatasetPlan plan, const std::filesystem::path& folder,
                               JobRenderer& pool,
                               const std::function<void(const DatasetProgress&)>& report,
                               std::stop_token stop = {});

}  // namespace itn
