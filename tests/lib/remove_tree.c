#include "remove_tree.h"

#include "ok.h"
#include "process.h"

void remove_tree(const char *path) {
    process_run((const char *[]){"/bin/rm", "-rf", path, NULL}, NULL, NULL);
}

char *remove_tree_begin(void) {
    return ok(g_dir_make_tmp("mesorig-XXXXXX", ERR));
}

void remove_tree_end(char **path) {
    remove_tree(*path);
    g_free(*path);
}
