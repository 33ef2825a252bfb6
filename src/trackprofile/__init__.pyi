from .assessment.assess import assess as assess
from .assessment.compare import compare as compare
from .assessment.trend import trend as trend
from .calibration.calibrate import calibrate as calibrate
from .inference.accuracy_bound import accuracy_bound as accuracy_bound
from .io import write as write
from .methods.method import infer as infer
from .models.sensor import Sensor as Sensor
from .models.spectrum import Spectrum as Spectrum
from .models.track import ElasticTrack as ElasticTrack
from .models.track import LayeredTrack as LayeredTrack
from .models.track import RigidTrack as RigidTrack
from .models.vehicle import Vehicle as Vehicle
from .reader import read as read
from .reporting.report import report as report
from .simulation.simulate import simulate as simulate

__version__: str
__all__: list[str]
