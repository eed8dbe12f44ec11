/* main() of every test program that has none of its own. */
#include "lib/test.h"

int main(int argc, char **argv) {
    return tests_run(argc, argv);
}
