/* The main() of every test program that does not define its own. */
#include "lib/test.h"

int main(int argc, char **argv) {
    return tests_run(argc, argv);
}
