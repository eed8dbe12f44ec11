/* mesorig: the command line. */
#include "base/program.h"
#include "bus/bus_errors.h"
#include "commands.h"

int main(int argc, char **argv) {
    program_set_locale();
    cli_print_readably();
    cli_check_output_at_exit();
    bus_errors_register();
    return cli_main(argc, argv);
}
