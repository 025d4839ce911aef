// itn shapes: what can be written as `builtin` in a scene file.
#include <fmt/format.h>

#include "client/commands/command.h"
#include "client/output.h"
#include "common/geometry/shapes.h"

namespace itn {

void add_shapes_command(CLI::App& app) {
  CLI::App* command = app.add_subcommand("shapes", "List the built-in shapes");
  command->callback([] {
    for (const ShapeInfo& shape : builtin_shapes()) {
      print_result("{:<16} {}\n", shape.name, shape.description);
    }
  });
}

}  // namespace itn
