/* import: makes sessions of data that others have measured. */
#include "exchange.h"

static const struct command *const commands[] = {&exchange_import_btf,   &exchange_import_pictures,
                                                 &exchange_import_rti,   &exchange_import_relight,
                                                 &exchange_import_ptm,   &exchange_import_bsdf,
                                                 &exchange_import_merl,  &exchange_import_utia,
                                                 &exchange_import_poses, NULL};

const struct command exchange_import = {
    .name = "import",
    .arguments = "KIND SOURCE -o DIR",
    .examples = "  mesorig import btf wool.btf -o wool.session\n"
                "  mesorig import poses poses.csv -c nominal.conf -s 36x36 -o print.session\n",
    .help = "Make a session of data that others have measured.",
    .run_arguments = cli_run_child,
    .children = commands};
