"""Methods that estimate a profile from a recording, behind one protocol: see `trackprofile.methods.method`.

Each published method is one module (or one package, as `cross_entropy`) with one public function, registered by name
in ``trackprofile.methods.method.METHODS``. The smoother of `trackprofile.inference` is the default method.
"""
