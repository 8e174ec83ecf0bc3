/* Preloaded by tests: makes a discovery callback run while a participant is destroyed.
 *
 * In the first participant of a process each discovery callback takes DISCOVERY_DELAY_MS longer. Its destructor waits,
 * where it replaces the listener, until a callback is running, at most for DISCOVERY_WAIT_MS. A callback that comes
 * meanwhile takes DISCOVERY_HOLD_MS longer.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <unistd.h>

typedef uintptr_t word;

static _Atomic word first;
static atomic_int running, destroyed, waiting;

static int setting(const char *name) { return getenv(name) ? atoi(getenv(name)) : 0; }

static void hold(word cache) {
    word none = 0;
    if (gettid() == getpid()) { /* not a callback, but an end point of this process */
        atomic_compare_exchange_strong(&first, &none, cache);
    } else if (cache == atomic_load(&first)) {
        atomic_fetch_add(&running, 1);
        usleep(1000u * (unsigned)setting(atomic_load(&waiting) ? "DISCOVERY_HOLD_MS" : "DISCOVERY_DELAY_MS"));
        atomic_fetch_sub(&running, 1);
    }
}

static void wait_for_callback(void) {
    if (atomic_exchange(&destroyed, 1)) return;
    atomic_store(&waiting, 1);
    for (int i = setting("DISCOVERY_WAIT_MS"); i > 0 && !atomic_load(&running); i--) usleep(1000);
    atomic_store(&waiting, 0);
}

/* A function of the middleware, of at most eight arguments, that does something else first. */
#define AFTER(work, library, name)                                               \
    word name(word a, word b, word c, word d, word e, word f, word g, word h) {  \
        word (*real)(word, word, word, word, word, word, word, word);            \
        *(void **)&real = dlsym(dlopen(library, RTLD_NOW), #name);               \
        work;                                                                    \
        return real(a, b, c, d, e, f, g, h);                                     \
    }

/* Called by the callbacks, and by this process for its own: a new end point, and the ends of one and of a participant. */
AFTER(hold(a), "librmw_dds_common.so", _ZN14rmw_dds_common10GraphCache10add_entityERK9rmw_gid_sRKNSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEESB_RK18rosidl_type_hash_sS3_RK17rmw_qos_profile_sb)
AFTER(hold(a), "librmw_dds_common.so", _ZN14rmw_dds_common10GraphCache13remove_entityERK9rmw_gid_sb)
AFTER(hold(a), "librmw_dds_common.so", _ZN14rmw_dds_common10GraphCache18remove_participantERK9rmw_gid_s)

AFTER(wait_for_callback(), "libfastrtps.so.2.14",
      _ZN8eprosima7fastdds3dds17DomainParticipant12set_listenerEPNS1_25DomainParticipantListenerE)
