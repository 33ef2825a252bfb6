"""Methods that estimate a profile from a recording, behind one protocol (`trackprofile.methods.method`).

Each published method is one module, or one package as `cross_entropy`, with one public function and one settings
class, registered by name in `trackprofile.methods.registry`. The smoother of `trackprofile.inference` is the default
method.
"""
