// itn, and itn-learn: the command line, the one without LibTorch, the other with all.
#include "client/command_line.h"
#include "client/commands/command.h"

int main(int argc, char** argv) {
  return itn::run_command_line(argc, argv, [](CLI::App& app) {
    itn::add_render_command(app);
    itn::add_predict_command(app);
    itn::add_fit_command(app);
    itn::add_refine_command(app);
    itn::add_dataset_command(app);
    itn::add_train_command(app);
    itn::add_evaluate_command(app);
    itn::add_experiment_command(app);
    itn::add_models_command(app);
    itn::add_export_command(app);
    itn::add_merge_command(app);
    itn::add_light_command(app);
    itn::add_shapes_command(app);
    itn::add_materials_command(app);
    itn::add_import_command(app);
    itn::add_probe_command(app);
    itn::add_relay_command(app);
    itn::add_completion_command(app);
  });
}
