#include "remove_tree.h"

#include "process.h"

void remove_tree(const char *path) {
    process_run((const char *[]){"/bin/rm", "-rf", path, NULL}, NULL, NULL);
}
