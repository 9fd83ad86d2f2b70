# The one list of public names and where each comes from; read by type checkers, and by __init__.py to load them on first use.
from .anatomy.anatomy import Anatomy as Anatomy
from .anatomy.parametric.size import TongueShape as TongueShape
from .anatomy.parametric.tongue import parametric_tongue as parametric_tongue
from .anatomy.subject import read_subject as read_subject
from .core.errors import InputError as InputError
from .core.errors import SolveError as SolveError
from .geometry.obstacles import Plane as Plane
from .geometry.obstacles import Sphere as Sphere
from .geometry.obstacles import Triangulated as Triangulated
from .geometry.rigid_motion import RigidMotion as RigidMotion
from .mechanics.activation import Activation as Activation
from .mechanics.activation import Excited as Excited
from .mechanics.activation import ramp as ramp
from .mechanics.contact import Contact as Contact
from .mechanics.contraction import Contraction as Contraction
from .mechanics.control import OpenLoop as OpenLoop
from .mechanics.control import StretchReflex as StretchReflex
from .mechanics.hyperelasticity import MooneyRivlin as MooneyRivlin
from .mechanics.hyperelasticity import NeoHookean as NeoHookean
from .mechanics.hyperelasticity import Yeoh as Yeoh
from .mechanics.loads import Pressure as Pressure
from .mechanics.model import Model as Model
from .mechanics.suspension import Suspension as Suspension
from .mechanics.tissue import Rayleigh as Rayleigh
from .mechanics.tissue import Tissue as Tissue
from .meshing.tongue_mesh import TongueMesh as TongueMesh
from .runs.figures import figure as figure
from .runs.run import Run as Run
from .simulation.quantities import field as field
from .simulation.quantities import history as history
from .simulation.quantities import summary as summary
from .simulation.simulation import Simulation as Simulation
from .simulation.stepping import Stepping as Stepping
from .solvers.tolerances import Tolerances as Tolerances
from .studies.sweep import sweep as sweep

__version__: str
