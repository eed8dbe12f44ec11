/* mesorig: the command line. */
#include "bus/bus_errors.h"
#include "commands.h"

#include <locale.h>

int main(int argc, char **argv) {
    setlocale(LC_CTYPE, "");
    cli_print_readably();
    cli_check_output_at_exit();
    bus_errors_register();
    return cli_main(argc, argv);
}
