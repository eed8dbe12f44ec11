/* mesorig: the command line. */
#include <glib.h>

int main(int argc, char **argv) {
    g_print("mesorig %s\n", MESORIG_VERSION);
    return argc > 0 && argv ? 0 : 2;
}
